"""Energy of planned motions, and motions that need less of it."""
