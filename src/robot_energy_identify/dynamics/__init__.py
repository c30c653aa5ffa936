"""Identification of rigid-body dynamics from motor torque."""
