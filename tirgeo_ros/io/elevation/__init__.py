"""Read elevation models."""
