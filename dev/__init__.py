"""Measure and stress the product: the laboratory, which is not installed."""
