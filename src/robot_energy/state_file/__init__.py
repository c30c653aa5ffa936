"""State files: what must outlive the process, on disk in two alternating slots."""

from robot_energy.state_file.bookkeeper import Bookkeeper, Submit, books_of
from robot_energy.state_file.slots import SlotPair, Stored

__all__ = ["Bookkeeper", "SlotPair", "Stored", "Submit", "books_of"]
