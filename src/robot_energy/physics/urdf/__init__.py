"""Robot descriptions (URDF): bounded parsing, checks, comparison."""
