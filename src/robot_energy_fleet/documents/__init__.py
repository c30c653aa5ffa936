"""Documents of fleets and of advice: results -> reports."""
