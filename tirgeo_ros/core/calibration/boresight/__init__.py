"""Estimate a camera's boresight and latency from sightings of surveyed points."""
