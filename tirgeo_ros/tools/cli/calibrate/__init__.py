"""Find parameters from recordings: lens, boresight, IMU noise and others.

boresight, aircraft, allan and imu write parameter files: give them to the nodes or --params after
the aircraft's own file. lens writes a calibration file for --camera and overlay_node's parameter
camera. tirgeo calibrate WHAT --help describes each, with an example.
"""
