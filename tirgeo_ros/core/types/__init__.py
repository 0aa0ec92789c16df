"""Define the records that the core passes on: samples, poses, verdicts, findings, errors."""
