"""Do the work of ``tirgeo import`` and ``tirgeo dump``."""
