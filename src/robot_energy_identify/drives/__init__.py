"""Identification of drive losses and efficiency maps."""
