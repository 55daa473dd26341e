"""A video or a folder of pictures to a reconstruction with the pose of every frame, in a work folder that resumes."""
