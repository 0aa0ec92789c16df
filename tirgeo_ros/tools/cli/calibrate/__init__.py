"""Find parameters from recordings: lens, boresight, IMU noise and others.

What boresight, aircraft, allan and imu write, the nodes and --params take after the aircraft's own
file; what lens writes, --camera and overlay_node's parameter camera take.

tirgeo calibrate WHAT --help tells of one, with an example.
"""
