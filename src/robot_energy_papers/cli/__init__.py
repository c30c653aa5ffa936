"""Commands that do the experiments of the papers again."""
