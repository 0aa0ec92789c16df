"""Resample pictures to the ground: orthophotos of frames, and the mosaic of them."""
