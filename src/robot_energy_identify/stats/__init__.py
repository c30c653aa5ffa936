"""Statistics that every identification shares: regression, held-out data, delays."""
