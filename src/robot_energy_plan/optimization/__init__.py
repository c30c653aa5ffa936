"""Less energy for the same work: which speeds, pauses and states cost least; how sure that is."""
