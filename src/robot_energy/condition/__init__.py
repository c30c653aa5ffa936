"""The condition of a robot: what a monitor learns of it while it runs."""
