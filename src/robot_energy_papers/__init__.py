"""The experiments of the papers, done again on the virtual rig with the project's own tools."""
