"""Identification of constant losses, the DC link and the meter's delay."""
