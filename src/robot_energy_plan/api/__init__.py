"""Public functions of prediction and optimisation."""
