"""Run nodes that measure the graph or stress it."""
