"""Intersect rays with the ground: a level, or an elevation model."""
