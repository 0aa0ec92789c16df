"""Find the filter's initial state, at rest or in motion."""
