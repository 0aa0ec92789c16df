"""Intersect rays with the ground: a surface of constant height, or an elevation model."""
