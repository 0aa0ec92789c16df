"""Show results: plots, progress bars."""
