"""Video files in and out, with their rate, times, audio and rotation."""
