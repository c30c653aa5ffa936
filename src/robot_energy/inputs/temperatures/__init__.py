"""Motor temperatures: every kind of source, and which readings are believed."""
