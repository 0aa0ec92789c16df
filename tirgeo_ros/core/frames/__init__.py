"""Convert between frames: rotations, axes, the WGS84 ellipsoid and its tangent planes."""
