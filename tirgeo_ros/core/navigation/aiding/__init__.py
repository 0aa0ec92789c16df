"""Aiding measurements of the filter, one module a source."""
