"""Public functions of identification and of testing a model."""
