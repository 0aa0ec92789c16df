"""Estimate parameters of sensors from recordings."""
