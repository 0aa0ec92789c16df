"""Fly several simulated aircraft through node graphs on one machine: cost, losses, mix-ups."""
