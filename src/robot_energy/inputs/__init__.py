"""What messages mean: joint states, motor temperatures and meters as blocks."""
