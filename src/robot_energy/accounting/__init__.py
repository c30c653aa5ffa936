"""Energy accounts: exact registers, integration, job intervals, comparison with the meter."""
