"""Convert aiding measurements to updates of the filter, one module for each source."""
