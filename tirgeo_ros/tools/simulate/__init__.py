"""A flight with truth: trajectory, sensors, pictures."""
