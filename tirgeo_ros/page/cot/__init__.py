"""Send Cursor-on-Target to the team while the aircraft flies."""
