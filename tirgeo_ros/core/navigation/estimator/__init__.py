"""Run the filter: take samples, return verdicts and solutions; the entrance for all users."""
