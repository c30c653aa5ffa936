"""The nodes, one a module."""
