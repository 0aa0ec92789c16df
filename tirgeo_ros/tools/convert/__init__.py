"""Do the work of ``tirgeo import`` and ``tirgeo dump``, and convert targets."""
