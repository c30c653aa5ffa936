"""Layouts of viewers, made from the message definitions."""

from robot_energy_report.layouts.viewers import LAYOUTS, Layout, write_layouts

__all__ = ["LAYOUTS", "Layout", "write_layouts"]
