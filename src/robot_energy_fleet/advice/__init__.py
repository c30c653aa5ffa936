"""What recordings say would save energy, and how much."""
