"""Pictures in and out: stills, videos with the pose of every frame, folders and video files that are written."""
