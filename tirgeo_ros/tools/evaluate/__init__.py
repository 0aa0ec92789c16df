"""Do the work of ``tirgeo evaluate``: the paper's experiment (section 5.1) on a flight."""
