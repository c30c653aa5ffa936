"""Time of every input: which stamps are accepted, and what separates two samples."""
