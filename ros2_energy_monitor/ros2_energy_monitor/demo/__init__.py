"""The demonstration and the live study."""
