"""What results say: on a terminal, and on pages with figures."""
