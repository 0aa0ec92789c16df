"""Convert between coordinate reference systems."""
