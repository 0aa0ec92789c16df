"""Measure and foretell errors of located ground points."""
