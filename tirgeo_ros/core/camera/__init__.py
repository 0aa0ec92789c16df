"""Model a camera: project points to pixels, pixels to rays, and propagate covariances."""
