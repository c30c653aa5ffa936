"""A second simulator: rigid bodies by MuJoCo, everything else by laws that no model file has."""
