"""Run the chosen estimator: take samples, return verdicts and solutions."""
