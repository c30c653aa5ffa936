"""Results as dataclasses: one set for the Python API, the commands and the reports."""
