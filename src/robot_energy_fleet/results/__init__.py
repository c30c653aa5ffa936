"""Results of fleets and of advice."""
