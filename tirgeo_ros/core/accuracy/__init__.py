"""Predict and measure the errors of located ground points."""
