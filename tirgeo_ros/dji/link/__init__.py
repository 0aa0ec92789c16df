"""Exchange frames with the aircraft over a serial port."""
