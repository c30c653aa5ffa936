"""Raw drive logs -> channels, by a short YAML file: the direct way, without a bag.

Positions and torques may lie in files of their own, on the motor or on the joint side, with
the log's own zero. See ``src/examples/identify`` for a commented example.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from robot_energy.blocks import Float
from robot_energy.config_file import load, read_text
from robot_energy.errors import LogFormatError
from robot_energy.identify.data.signals import Channels
from robot_energy.logs.mapping import POSITION_UNITS
from robot_energy.logs.table import LogTable
from robot_energy.model import RobotModel, validate
from robot_energy.physics.drivetrain import Drivetrain

PLACE = "{recording}"  # in a file name: the name of a recording
Number = Annotated[float, Field(allow_inf_nan=False)]
Text = Annotated[str, Field(min_length=1)]
Name = Annotated[str, Field(pattern=r"^[\w.-]+$")]


class RawLogEntry(BaseModel):
    """Base of all parts: unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class TorqueColumn(RawLogEntry):
    """One quantity of every joint in one file.

    Attributes:
        file: CSV with a header, plain or gzip, in the data folder; ``{recording}`` stands
            for the name of each recording.
        columns: One per joint, base first; absent: the first columns of the file.
        side: Whether motors or joints were measured.
    """

    file: Text
    columns: list[Text] | None = None
    side: Literal["motor", "joint"]


class JointColumn(TorqueColumn):
    """Positions.

    Attributes:
        unit: Of the motor or joint.
        zero: Position of each joint in the URDF where the log says 0. [rad] or [m]
    """

    unit: Literal["rad", "deg", "m", "mm"]
    zero: list[Number] | None = None


class Torque(TorqueColumn):
    """Torques, or currents with the torque constant of each motor.

    Attributes:
        unit: ``newton_metre``, ``newton`` or ``ampere``.
        torque_constant: Per motor, for ``ampere``. [N m/A]
    """

    unit: Literal["newton_metre", "newton", "ampere"]
    torque_constant: list[Number] | None = None

    @model_validator(mode="after")
    def _check(self) -> Torque:
        if (self.unit == "ampere") != (self.torque_constant is not None):
            raise ValueError("torque_constant for ampere, and only for it")
        if self.unit == "ampere" and self.side == "joint":
            raise ValueError("side: motor for ampere")
        return self


class CouplingEntry(RawLogEntry):
    """A motor that turns along with another joint, as in a model file."""

    motor: Text
    joint: Text
    ratio: Number


class RawLogReference(RawLogEntry):
    """Published friction, to be printed beside the fit, joint side.

    Attributes:
        viscous: Torque of each joint per its own velocity. [N m s/rad]
        coulomb: [N m]
        source: Where it comes from.
    """

    viscous: list[Number]
    coulomb: list[Number]
    source: str = ""


class DriveLog(RawLogEntry):
    """What a raw log holds, and the robot it was made on.

    Attributes:
        rate: Rows per second. [Hz]
        urdf: File with kinematics and bodies; not needed beside a model file.
        joints: As in the URDF, base first.
        recordings: Names of several recordings of one robot, in files of their own.
        gear_ratio: Motor turns per joint turn; the sign is the sense.
    """

    schema_version: Literal[1]
    description: str = ""
    rate: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    urdf: Text | None = None
    joints: Annotated[list[Text], Field(min_length=1)]
    recordings: Annotated[list[Name], Field(min_length=1)] | None = None
    gear_ratio: list[Number] | None = None
    coupling: tuple[CouplingEntry, ...] = ()
    position: JointColumn
    torque: Torque
    reference: RawLogReference | None = None

    @model_validator(mode="after")
    def _check(self) -> DriveLog:
        lists: dict[str, list[Any] | None] = {
            "gear_ratio": self.gear_ratio,
            "position.columns": self.position.columns,
            "position.zero": self.position.zero,
            "torque.columns": self.torque.columns,
            "torque.torque_constant": self.torque.torque_constant,
        }
        if self.reference is not None:
            lists["reference.viscous"] = self.reference.viscous
            lists["reference.coulomb"] = self.reference.coulomb
        for key, values in lists.items():
            if values is not None and len(values) != len(self.joints):
                raise ValueError(
                    f"{len(self.joints)} entries of {key}, as many as joints; found {len(values)}"
                )
        if (self.urdf is None) != (self.gear_ratio is None):
            raise ValueError("urdf and gear_ratio together (or neither, beside a model file)")
        named = [PLACE in channel.file for channel in (self.position, self.torque)]
        if named != [self.recordings is not None] * 2:
            raise ValueError(f"recordings together with {PLACE} in both file names, or neither")
        if self.recordings is not None and len(set(self.recordings)) < len(self.recordings):
            raise ValueError("every name of recordings once")
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the recordings; one that has none is called by its positions."""
        return tuple(self.recordings or (self.position.file,))

    @property
    def files(self) -> tuple[str, ...]:
        """All files, positions first, each once."""
        channels = (self.position, self.torque)
        both = [channel.file.replace(PLACE, name) for name in self.names for channel in channels]
        return tuple(dict.fromkeys(both))


def load_drive_log(path: str | Path) -> DriveLog:
    """Load the description of a raw log.

    Args:
        path: A YAML file.

    Returns:
        The description.

    Raises:
        LogFormatError: Naming the bad key, what was found and what was expected.
    """
    return load(path, DriveLog, LogFormatError, "mapping", "see src/examples/identify")


def model_of(log: DriveLog, folder: Path, beside: Path | None = None) -> RobotModel:
    """Return a model with what the log says; all else is zero, assumed, to be identified.

    Args:
        log: The description, with URDF and gear ratios.
        folder: Where the URDF lies.
        beside: Where it may lie instead: the folder of the description.

    Returns:
        The model before identification.

    Raises:
        LogFormatError: If the log names no URDF, or it cannot be read.
        ModelFileError: If the pieces do not make a model.
    """
    if log.urdf is None or log.gear_ratio is None:
        raise LogFormatError(
            "the mapping names no urdf and no gear_ratio", "both, or a model file (--model)"
        )
    path = folder / log.urdf
    if beside is not None and not path.is_file():
        path = beside / log.urdf
    urdf_xml = read_text(path, LogFormatError, "URDF", expected="a URDF file")
    friction = {"coulomb": _figure(0.0), "viscous": {"law": "constant", "viscous": _figure(0.0)}}
    joints = [
        {
            "name": name,
            "gear_ratio": _figure(ratio, "mapping of the log"),
            "rotor_inertia": _figure(0.0),
            "friction": friction,
        }
        for name, ratio in zip(log.joints, log.gear_ratio, strict=True)
    ]
    coupling = [
        {**entry.model_dump(), "ratio": _figure(entry.ratio, "mapping of the log")}
        for entry in log.coupling
    ]
    data = {
        "schema_version": 1,
        "robot": {"type": log.description or "robot"},
        "urdf": {"path": log.urdf, "source": log.urdf},
        "joints": joints,
        "coupling": coupling,
        "cabinet": {"loss_grid": _figure(0.0), "loss_dc": _figure(0.0)},
        "temperature": {"fallback_degc": 25.0},
    }
    return validate(data, str(path), urdf_xml)


def read_channels(
    log: DriveLog, model: RobotModel, folder: Path, recording: str | None = None
) -> Channels:
    """Read the files of a raw log.

    Args:
        log: The description.
        model: Drivetrain of the robot.
        folder: Where the files lie.
        recording: One of `DriveLog.names`; default the first.

    Returns:
        Positions of the joints and torques of the motors, on one clock.

    Raises:
        LogFormatError: If a file cannot be read, or the two differ in length.
    """
    if tuple(log.joints) != model.joint_names:
        raise LogFormatError(
            f"the mapping has the joints {', '.join(log.joints)}",
            f"those of the model in its order: {', '.join(model.joint_names)}",
        )
    drivetrain = Drivetrain.from_model(model)
    name = log.names[0] if recording is None else recording
    position = (
        _read(log.position, len(log.joints), folder, name) * POSITION_UNITS[log.position.unit]
    )
    torque = _read(log.torque, len(log.joints), folder, name)
    if len(position) != len(torque):
        raise LogFormatError(
            f"'{log.position.file}' has {len(position)} rows and '{log.torque.file}' has "
            f"{len(torque)}",
            "one torque for every position",
            "cut both files at the same instants",
        )
    if log.position.side == "motor":
        position = drivetrain.joint_velocity_from_motor(position)  # the same map
    if log.position.zero is not None:
        position = position + np.asarray(log.position.zero)
    if log.torque.torque_constant is not None:
        torque = torque * np.asarray(log.torque.torque_constant)
    if log.torque.side == "joint":
        torque = drivetrain.motor_torque_from_joint(torque)
    return Channels(log.rate, position, torque)


def _figure(value: float, source: str = "not identified") -> dict[str, object]:
    return {"value": value, "tag": "assumed", "source": source}


def _read(channel: TorqueColumn, n_joints: int, folder: Path, recording: str) -> Float:
    path = folder / channel.file.replace(PLACE, recording)
    table = LogTable(path)
    names = channel.columns or list(table.columns[:n_joints])
    if len(names) < n_joints:
        raise LogFormatError(f"{path} has {len(names)} columns", f"one per joint: {n_joints}")
    return table.numbers([table.require(name) for name in names])
