"""What a camera recorded beside its pictures: accelerometer, gyroscope, positions; read from videos and logs."""
