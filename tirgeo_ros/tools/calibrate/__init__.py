"""Do the work of ``tirgeo calibrate``."""
