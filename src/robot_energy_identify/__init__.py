"""The model from recordings: identification, apart from the online chain, of what it runs."""
