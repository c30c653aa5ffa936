"""The energy page: what the monitors publish, as a live web page, a saved page and metrics."""
