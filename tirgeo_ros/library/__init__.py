"""Offer filter, projection and bags to Python programs: arrays and data frames in and out."""
