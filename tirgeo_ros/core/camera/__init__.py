"""Model a camera: points to pixels, pixels to rays, and their covariances."""
