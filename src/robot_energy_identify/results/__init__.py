"""Results of identification, checks and tests of a model."""
