"""Process many flights, on this computer or a cluster, and show them on one page."""
