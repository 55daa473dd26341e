"""Sensor data that a camera recorded with its images: accelerometer, gyroscope, positions; from videos and logs."""
