"""A bag of energy topics, as a node would have published them."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from robot_energy.accounting.account import EnergyAccount
from robot_energy.bag import DEFAULT_QOS, LATCHED_QOS, BagWriter
from robot_energy.messages.fields import ENERGY_REGISTERS
from robot_energy.messages.friction import JOINT_FRICTION, FrictionWriter
from robot_energy.messages.payload import PAYLOAD, PayloadWriter
from robot_energy.messages.power import POWER_STATE, PowerStateWriter
from robot_energy.messages.registers import RegistersWriter
from robot_energy.messages.torque import JOINT_TORQUE, TorqueWriter
from robot_energy.model import RobotModel
from robot_energy.pipeline import Output
from robot_energy.pipeline.torque_stage import PayloadChange
from robot_energy.timeline.blocks import FrictionBlock


class EnergyBagWriter(AbstractContextManager["EnergyBagWriter"]):
    """Writes the energy topics into a new bag, which is made at the first torque."""

    TOPICS: ClassVar = {
        "/energy/joint_torque": JOINT_TORQUE,
        "/energy/joint_friction": JOINT_FRICTION,
        "/energy/power": POWER_STATE,
        "/energy/registers": ENERGY_REGISTERS,
        "/energy/payload": PAYLOAD,
    }

    def __init__(
        self, path: str | Path, overwrite: bool, model: RobotModel, origin: str, source: Path
    ) -> None:
        self._torque = TorqueWriter(model.joint_names, model.model_id)
        self._friction = FrictionWriter(model)
        identity = (model.joint_names, model.model_id, model.auxiliary or (), model.unmodelled)
        self._power = PowerStateWriter(*identity)
        self._registers = RegistersWriter(*identity)
        self._payload = PayloadWriter(model.model_id)
        self._payloads = 0  # changes written
        self._counted_ns: int | None = None
        self._made = (path, overwrite, origin, source)
        self._bag: BagWriter | None = None
        self._frictions: list[FrictionBlock] = []

    def write(
        self, output: Output, account: EnergyAccount, payloads: Sequence[PayloadChange]
    ) -> None:
        torque, friction, power, registers, payload = self.TOPICS
        if output.friction is not None:
            self._frictions.append(output.friction)
        if self._bag is None and output.torque is None:
            return  # no joint state was of use yet, and perhaps none will be
        for block in self._frictions:
            self._open().write(friction, block.stamp_ns, self._friction.encode(block))
        self._frictions.clear()
        if output.torque is not None:
            now = output.torque.stamp_ns[:1]  # a change from the start has no time of its own
            for change in payloads[self._payloads :]:
                time = np.array([change.from_ns]) if change.from_ns else now
                self._open().write(payload, time, self._payload.encode(change))
            self._payloads = len(payloads)
            rows = self._torque.encode(output.torque)
            self._open().write(torque, output.torque.stamp_ns, rows)
        if output.means is not None:
            rows = self._power.encode(output.means, account.comparison.location)
            self._open().write(power, output.means.stamp_ns, rows)
        now = account.registers.time.end_ns
        if now is not None and now != self._counted_ns:
            row = self._registers.encode(account)
            if row is not None:
                self._open().write(registers, np.array([now]), row)
            self._counted_ns = now

    def __exit__(self, *error: Any) -> None:
        if self._bag is not None:
            self._bag.__exit__(*error)

    def _open(self) -> BagWriter:
        if self._bag is None:
            path, overwrite, origin, source = self._made
            self._bag = BagWriter(path, overwrite=overwrite, origin=origin, inputs=(source,))
            for topic, msgtype in self.TOPICS.items():
                qos = LATCHED_QOS if msgtype in (JOINT_FRICTION, PAYLOAD) else DEFAULT_QOS
                self._bag.add_topic(topic, msgtype, qos)
        return self._bag
