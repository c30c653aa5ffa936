"""Results of prediction and optimisation."""
