"""The paper's experiment (section 5.1) on a recorded flight: ``tirgeo evaluate``."""
