"""Services: registers, intervals, payload."""
