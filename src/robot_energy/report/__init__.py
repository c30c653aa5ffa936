"""What a replay says: plain values, tables for the terminal, figures."""

from robot_energy.report.model_summary import summarise_model
from robot_energy.report.summary import summarise
from robot_energy.report.tables import headline, print_replay

__all__ = ["headline", "print_replay", "summarise", "summarise_model"]
