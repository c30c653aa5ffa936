"""A bag through the pipeline."""
