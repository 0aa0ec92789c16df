"""Do the work of ``tirgeo budget``."""
