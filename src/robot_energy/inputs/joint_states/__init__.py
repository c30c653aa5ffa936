"""Joint states: names, order, units, several publishers, plausibility."""
