"""Estimate: samples in, verdicts and solutions out; the one entrance to the filter."""
