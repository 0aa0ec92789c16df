"""Fit polynomials that take pixels of an orthophoto to a plane of metres."""
