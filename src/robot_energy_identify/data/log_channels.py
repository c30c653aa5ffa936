"""Logs of drives -> channels, by the mapping of their columns: without a bag."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from robot_energy.foundation.config_file import read_text
from robot_energy.foundation.errors import LogFormatError
from robot_energy.foundation.files.regular_file import xml_encoding
from robot_energy.model import RobotModel, validate
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.timeline.streams import StampOrder
from robot_energy_identify.data.observations import Channels, stretches
from robot_energy_logs.log_import import open_logs
from robot_energy_logs.mapping import LogMapping


def model_of(mapping: LogMapping, folders: Sequence[Path]) -> RobotModel:
    """Return a model with what a mapping says; all else is zero, assumed, to be identified.

    The folders are those where the URDF of its ``robot`` may lie.
    """
    robot = mapping.robot
    if robot is None:
        raise LogFormatError(
            "the mapping has no entry robot", "urdf and gear_ratio in it, or a model file (--model)"
        )
    paths = [folder / robot.urdf for folder in folders]
    path = next((path for path in paths if path.is_file()), paths[0])
    urdf_xml = read_text(
        path, LogFormatError, "URDF", expected="a URDF file", encoding_of=xml_encoding
    )
    friction = {"coulomb": _figure(0.0), "viscous": {"law": "constant", "viscous": _figure(0.0)}}
    joints = [
        {
            "name": name,
            "gear_ratio": _figure(ratio, "mapping of the log"),
            "rotor_inertia": _figure(0.0),
            "friction": friction,
        }
        for name, ratio in zip(mapping.joints.names, robot.gear_ratio, strict=True)
    ]
    coupling = [
        {**entry.model_dump(), "ratio": _figure(entry.ratio, "mapping of the log")}
        for entry in robot.coupling
    ]
    data = {
        "schema_version": 1,
        "robot": {"type": mapping.description or "robot"},
        "urdf": {"path": robot.urdf, "source": robot.urdf},
        "joints": joints,
        "coupling": coupling,
        "cabinet": {"loss_grid": _figure(0.0), "loss_dc": _figure(0.0)},
        "temperature": {"fallback_degc": 25.0},
    }
    return validate(data, str(path), urdf_xml)


def _figure(value: float, source: str = "not identified") -> dict[str, object]:
    return {"value": value, "tag": "assumed", "source": source}


def read_channels(
    paths: Sequence[str | Path], mapping: LogMapping, model: RobotModel
) -> dict[str, list[Channels]]:
    """Return stretches without gaps of each recording of a log, by its name."""
    names = tuple(mapping.joints.names)
    if names != model.joint_names:
        raise LogFormatError(
            f"the mapping has the joints {', '.join(names)}",
            f"those of the model in its order: {', '.join(model.joint_names)}",
        )
    effort = mapping.joints.effort
    if effort is None or effort.side is None or effort.si_unit == "ampere":
        raise LogFormatError(
            "the mapping names no torque of motors or joints",
            "joints.effort with side, and torque_constant for a current",
        )
    if mapping.joints.position is None:
        raise LogFormatError(
            "the mapping names no positions",
            "joints.position: the dynamics follow from where the joints are",
            "`robot-energy identify drives --log` takes a log of speeds, torques and powers",
        )
    drivetrain = Drivetrain.from_model(model)
    found: dict[str, list[Channels]] = {}
    rate = mapping.time.rate
    for log in open_logs(paths, mapping, drivetrain):
        rows = log.whole()
        if log.account.rejected:
            raise LogFormatError(
                f"{' and '.join(map(str, log.tables))} cannot be used ({log.account.reasons})",
                "a number in every cell of the columns used",
            )
        torque = rows.effort
        if effort.side == "joint":
            torque = drivetrain.motor_torque_from_joint(torque)
        if mapping.time.rate is not None:  # the rows are the grid
            found[log.name] = [Channels(mapping.time.rate, rows.joint_position, torque)]
            continue
        segment = StampOrder().segments(rows.stamp_ns)
        found[log.name] = stretches(rows.stamp_ns, segment, rows.joint_position, torque, rate)
        rate = found[log.name][0].rate
    return found
