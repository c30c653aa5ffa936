"""The registers of a replayed bag at each UTC minute, and its jobs, as a history takes them."""

from __future__ import annotations

from typing import Any

from robot_energy.accounting.account import EnergyAccount
from robot_energy.bag.cdr.batch import RawBatch
from robot_energy.messages.fields import ENERGY_REGISTERS
from robot_energy.messages.registers import RegistersWriter
from robot_energy.model import RobotModel
from robot_energy_history.readings import Reading, ReadingDecoder


class BagMinutes:
    """Collects the registers of a replay, in the messages that a monitor would publish."""

    def __init__(self, model: RobotModel) -> None:
        self._writer = RegistersWriter(
            model.joint_names, model.model_id, model.auxiliary or (), model.unmodelled
        )
        self._messages: list[bytes] = []

    def take(self, account: EnergyAccount, minute_ns: int) -> None:
        """Take the registers as they stand.

        Args:
            minute_ns: UTC minute up to which all samples are counted; 0 for none. [ns]
        """
        row = self._writer.encode(account, True, minute_ns)
        if row is not None:
            self._messages.append(row[0].tobytes())

    def readings(self) -> tuple[Reading, ...]:
        """Return all of them, in order."""
        batch = RawBatch.from_messages(
            "energy/registers", ENERGY_REGISTERS, [0] * len(self._messages), self._messages
        )
        return tuple(ReadingDecoder().decode(batch)) if self._messages else ()


def history_job(number: int, job: dict[str, Any]) -> dict[str, Any]:
    """Return a job of a bag as the history has it."""
    return {
        "id": number,
        "start": job["start_ns"],
        "stop": job["end_ns"],
        "name": job["name"],
        "observed_ns": job["observed_ns"],
        "gap_ns": job["gap_ns"],
        "compared_ns": job["compared_ns"],
        "predicted_import_microjoule": job["grid_import_microjoule"],
        "predicted_return_microjoule": job["grid_return_microjoule"],
        "measured_microjoule": job["measured_microjoule"] or 0,
        "predicted_microjoule_at_meter": job["predicted_at_meter_microjoule"] or 0,
        "peak_power": job["peak_grid_power"],
    }
