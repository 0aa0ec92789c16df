"""Read calibration files of cameras and write pictures with coordinates."""
