"""Show results: plots, progress bars, video files."""
