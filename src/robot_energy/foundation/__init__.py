"""What all else stands on: errors, units, tables of kinds, files."""
