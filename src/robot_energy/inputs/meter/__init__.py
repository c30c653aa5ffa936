"""Power meters: power readings, energy counters, voltage and current pairs."""
