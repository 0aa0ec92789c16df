"""Show results: lines, plots, pages, progress bars."""
