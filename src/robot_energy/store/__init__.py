"""State files: what must outlive the process, on disk in two alternating slots."""

from robot_energy.store.account_store import AccountStore, load_account
from robot_energy.store.slot_store import Submit
from robot_energy.store.slots import SlotPair, Stored

__all__ = ["AccountStore", "SlotPair", "Stored", "Submit", "load_account"]
