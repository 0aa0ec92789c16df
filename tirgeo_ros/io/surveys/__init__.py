"""Read surveyed points, and write located ones."""
