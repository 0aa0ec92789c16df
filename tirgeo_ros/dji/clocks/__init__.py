"""Convert the aircraft's counters and clocks to this computer's time."""
