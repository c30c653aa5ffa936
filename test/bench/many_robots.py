"""Publishes what the monitors of many robots do: power, registers, diagnostics, learned friction.

Usage: ``many_robots.py ROBOTS [POWER_RATE]``; prints ``ready`` once all is there, and ends with
its input. Job intervals are answered, 16 of each robot.
"""

from __future__ import annotations

import select
import sys
import time
from typing import Any

import rclpy
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.serialization import serialize_message
from ros2_energy_msgs.msg import (
    EnergyInterval,
    EnergyRegisters,
    FrictionCondition,
    JointCondition,
    JointEnergy,
    JointPower,
    PowerState,
)
from ros2_energy_msgs.srv import ListIntervals

from ros2_energy_monitor.base.publishers import (
    CONDITION_TOPIC,
    POWER_TOPIC,
    REGISTERS_TOPIC,
    best_effort,
    latched,
    reliable,
)

JOINTS = [f"joint_a{number}" for number in range(1, 7)]
STATUSES, VALUES, JOBS = 8, 10, 16
WATT = 700
SECOND = 10**9
STAMP = slice(4, 12)  # of a serialised message that begins with its header


def main() -> None:
    """Publish until the input ends."""
    robots, rate = int(sys.argv[1]), float(sys.argv[2]) if len(sys.argv) > 2 else 0.0
    rclpy.init()
    node = rclpy.create_node("many_robots")
    names = [f"cell{number // 10}/r{number:03d}" for number in range(robots)]
    begin = time.time_ns() // SECOND * SECOND
    senders = [_Robot(node, name, begin, bool(rate)) for name in names]
    statuses = node.create_publisher(DiagnosticArray, "/diagnostics", 50)
    diagnosed = [_statuses(name) for name in names]
    print("ready", flush=True)
    period = 1.0 / max(rate, 1.0)
    second, due = 0, time.monotonic()
    while not select.select([sys.stdin], [], [], 0)[0]:
        now = time.time_ns()
        if rate:
            for one in senders:
                one.send_power(now)
        if now - begin >= (second + 1) * SECOND:
            second = (now - begin) // SECOND
            for one, message in zip(senders, diagnosed, strict=True):
                one.send_registers(begin + second * SECOND, second)
                message.header.stamp = _time(now)
                statuses.publish(message)
                if second % 10 == 1:
                    one.send_friction(now)
        due += period
        while (left := due - time.monotonic()) > 0:
            rclpy.spin_once(node, timeout_sec=left)


class _Robot:
    def __init__(self, node: Any, name: str, begin: int, power: bool) -> None:
        prefix = f"/{name}/"
        self._registers = node.create_publisher(
            EnergyRegisters, prefix + REGISTERS_TOPIC, reliable(100)
        )
        self._friction = node.create_publisher(
            FrictionCondition, prefix + CONDITION_TOPIC, latched(1)
        )
        self._message = EnergyRegisters(model_id="m1", energy_start=_time(begin))
        self._message.joints = [JointEnergy(name=joint) for joint in JOINTS]
        self._learned = FrictionCondition(
            model_id="m1",
            joints=[
                JointCondition(name=joint, multiplier=1.1, valid=True,
                               bucket_multiplier=[1.0] * 40, bucket_time=[60.0] * 40)
                for joint in JOINTS
            ],
        )  # fmt: skip
        self._power = node.create_publisher(PowerState, prefix + POWER_TOPIC, best_effort(200))
        state = PowerState(model_id="m1", period=0.1, predicted_grid_power=float(WATT))
        state.joints = [JointPower(name=joint) for joint in JOINTS]
        self._state = bytearray(serialize_message(state)) if power else None
        jobs = [
            EnergyInterval(id=number, name="weld", start=_time(begin + number), end=_time(begin))
            for number in range(1, JOBS + 1)
        ]

        def listed(_: Any, answer: Any) -> Any:
            answer.intervals = jobs
            return answer

        node.create_service(ListIntervals, prefix + "energy_monitor/list_intervals", listed)

    def send_power(self, now: int) -> None:
        assert self._state is not None
        self._state[STAMP] = (now // SECOND).to_bytes(4, "little") + (now % SECOND).to_bytes(
            4, "little"
        )
        self._power.publish(bytes(self._state))

    def send_registers(self, stamp: int, second: int) -> None:
        message = self._message
        message.header.stamp = _time(stamp)
        message.observed_ns = second * SECOND
        message.predicted_import_microjoule = second * WATT * 10**6
        for joint in message.joints:
            joint.friction_microjoule = second * 10**6
        self._registers.publish(message)

    def send_friction(self, now: int) -> None:
        self._learned.header.stamp = _time(now)
        self._friction.publish(self._learned)


def _statuses(name: str) -> DiagnosticArray:
    return DiagnosticArray(
        status=[
            DiagnosticStatus(
                name=f"{name}/energy_monitor: subject {number}", message="all is well",
                values=[KeyValue(key=f"figure_{one}", value="1.25") for one in range(VALUES)],
            )
            for number in range(STATUSES)
        ]
    )  # fmt: skip


def _time(stamp_ns: int) -> Time:
    return Time(sec=stamp_ns // SECOND, nanosec=stamp_ns % SECOND)


if __name__ == "__main__":
    main()
