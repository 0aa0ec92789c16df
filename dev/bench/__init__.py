"""Measure speed, each figure beside a stated reference: ``make bench``."""
