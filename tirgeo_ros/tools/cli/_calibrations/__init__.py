"""The verbs ``tirgeo calibrate WHAT``: one module each, of the form of all verbs."""
