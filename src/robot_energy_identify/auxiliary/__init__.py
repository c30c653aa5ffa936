"""Power of the states of loads outside of the cabinet."""
