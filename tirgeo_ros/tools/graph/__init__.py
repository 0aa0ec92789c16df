"""Run the node graph as processes; do the work of ``tirgeo demo``."""
