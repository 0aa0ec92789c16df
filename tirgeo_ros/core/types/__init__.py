"""Define the records that go through the core: samples, poses, verdicts, findings, errors."""
