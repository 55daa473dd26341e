"""Sensor data that a camera recorded with its images: accelerometer, gyroscope, positions; from videos and logs."""

# Modules, their limits, and their tests in `tests/estimator/telemetry`:
# - gpmf: Read the metadata format of GoPro (GPMF; https://gopro.github.io/gpmf-parser/). Limits: MAX_DEPTH, MAX_KEYS,
#   MIN_FIX, METRES_PER_DILUTION, MAX_PACKET_S. Tests: test_telemetry.py.
# - readers: Read the sensor data of a video, or of a log next to it. Limits: MAX_TRACK_BYTES, MAX_PACKETS,
#   MAX_LOG_BYTES, MAX_FRAME_RATE, N_PROBED_PACKETS. Tests: test_telemetry.py.
# - records: Sensor data of one recording. Times are in seconds after the first frame of its video. Tests:
#   test_telemetry.py.
