"""The energy page of live monitors."""
