"""Find the first state of the filter, at rest or in motion."""
