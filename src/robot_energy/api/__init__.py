"""The public Python API; `import robot_energy as re` gives all of it."""
