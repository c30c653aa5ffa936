"""Predicted beside measured power: readings, counters, and what both curves cover."""

from robot_energy.comparison.comparison import Comparison
from robot_energy.comparison.counter import Counter
from robot_energy.comparison.curve import MeterCurve
from robot_energy.comparison.judgement import Judgement
from robot_energy.comparison.pieces import Compared, Pieces

__all__ = ["Compared", "Comparison", "Counter", "Judgement", "MeterCurve", "Pieces"]
