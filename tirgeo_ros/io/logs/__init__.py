"""Read the logs of other autopilots, receivers and cameras."""
