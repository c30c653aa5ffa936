"""Thermal networks of motors from their losses and temperatures."""
