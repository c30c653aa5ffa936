"""Statuses on ``/diagnostics``: inputs, node, energy."""
