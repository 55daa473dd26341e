"""Input frames (images, videos with a pose per frame) and output (image folders, video files)."""
