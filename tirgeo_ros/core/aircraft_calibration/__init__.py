"""Estimate the aircraft's lever arms, angles and delays from the filter's innovations."""
