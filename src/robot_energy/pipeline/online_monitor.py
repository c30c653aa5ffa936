"""The monitor in one's own loop: arrays in, power out, by the path of the nodes.

Arrays become the messages that a robot would have sent, so that stamps, names, gaps, outliers,
derivative, temperatures and meter are treated as they are live and in a replay.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robot_energy.accounting.account import EnergyAccount
from robot_energy.bag.cdr.decode import Encoder, RawBatch, stamp_columns
from robot_energy.foundation.errors import ParameterError, ShapeError
from robot_energy.inputs.joint_states.joint_states import JOINT_STATE, JointStateIngest
from robot_energy.inputs.meter.kinds import POWER_READING
from robot_energy.inputs.meter.meter import MeterIngest
from robot_energy.inputs.temperatures.kinds import MOTOR_TEMPERATURES
from robot_energy.inputs.temperatures.temperatures import TemperatureIngest
from robot_energy.messages.fields import JOINT_STATES_TOPIC, METER_TOPIC, TEMPERATURES_TOPIC
from robot_energy.pipeline import EnergyPipeline, Output, Settings
from robot_energy.replay.power_table import power_table
from robot_energy.replay.setup import ModelName, effort_meaning, model_of
from robot_energy.results.energy import EnergyBreakdown, energy_of
from robot_energy.timeline.blocks import EffortMeaning, Int, MeterLocation, MeterMeaning
from robot_energy.timeline.time_series import TimeSeries

OptionalArray = ArrayLike | None
LOCATIONS = {"grid": MeterLocation.GRID, "dc_bus": MeterLocation.DC_BUS}


class OnlineMonitor:
    """Watches a robot from one's own loop.

    How the samples are spread over calls makes no difference to any figure. Samples with
    values that cannot be right never raise: they are refused and counted in `rejected`.

    Args:
        model: A model, its file, or the name of a shipped one.
        effort: What ``joint_effort`` is: ``none``, ``motor_current``, ``motor_torque`` or
            ``joint_torque``.
        meter_location: Where the meter sits: ``grid`` or ``dc_bus``.
        settings: Of the pipeline; None for those of a replay.

    Attributes:
        model: The model used.
        pipeline: The stages and the account.

    Raises:
        RobotEnergyError: If the model cannot be used.
        ParameterError: If ``effort`` or ``meter_location`` is none of those above.
    """

    def __init__(
        self,
        model: ModelName,
        *,
        effort: str = "none",
        meter_location: str = "grid",
        settings: Settings | None = None,
    ) -> None:
        self.model = model_of(model)
        meaning = effort_meaning(effort)
        settings = replace(settings or Settings(power_period=None), effort=meaning)
        if meter_location not in LOCATIONS:
            raise ParameterError(
                f"meter_location is '{meter_location}'", f"one of {', '.join(LOCATIONS)}"
            )
        self._location = LOCATIONS[meter_location]
        self._meter = MeterIngest()
        self.pipeline = EnergyPipeline(self.model, settings.with_meter(*self._meter.source.limits))
        names = self.model.joint_names
        self._joints = JointStateIngest(
            names,
            limits=self.pipeline.torque.robot.limits,
            effort=meaning is not EffortMeaning.NONE,
            max_gap=settings.max_gap,
        )
        self._temperatures = TemperatureIngest(
            names, stale_after=self.model.temperature.stale_after
        )
        self._encoders: dict[tuple[bool, bool], Encoder] = {}
        self._degc = Encoder(
            MOTOR_TEMPERATURES, {"joint_names": names}, {"temperature_degc": len(names)}
        )
        self._reading = Encoder(POWER_READING)

    def push(
        self,
        stamp_ns: ArrayLike,
        joint_position: ArrayLike,
        joint_velocity: OptionalArray = None,
        joint_effort: OptionalArray = None,
        motor_temperature_degc: OptionalArray = None,
        measured_power: OptionalArray = None,
    ) -> TimeSeries:
        """Take joint states, one or many, and return the power that became complete.

        Args:
            stamp_ns: When they were measured, shape () or (N,). [ns since 1970]
            joint_position: In model order, shape (n,) or (N, n). [rad] or [m]
            joint_velocity: Same shape; None: differentiated. [rad/s] or [m/s]
            joint_effort: Same shape; its meaning is an argument of the class.
            motor_temperature_degc: At the same stamps, same shape; NaN where unknown. [degC]
            measured_power: Readings of the meter at the same stamps, shape () or (N,); NaN
                where there is none. [W]

        Returns:
            One row per completed sample, the columns of `ReplayResult.power` without those of
            the meter. A sample is complete once the stamps have passed it by the window of the
            derivative and the waiting time of temperatures, together about 0.1 s; those of 60 ms
            are computed together.

        Raises:
            ShapeError: If an array has another shape, or a stamp is beyond the year 2038.
        """
        stamp = _stamps(stamp_ns)
        n_joints = len(self.model.joint_names)
        shape = (len(stamp), n_joints)
        columns: dict[str, Any] = stamp_columns(stamp)
        columns["position"] = _array("joint_position", joint_position, shape)
        given = {"velocity": joint_velocity, "effort": joint_effort}
        for name, values in given.items():
            empty = np.empty((len(stamp), 0))
            columns[name] = empty if values is None else _array(f"joint_{name}", values, shape)
        rows = self._joint_states(joint_velocity is not None, joint_effort is not None).encode(
            columns, len(stamp)
        )
        temperatures = meter = None
        if motor_temperature_degc is not None:
            temperatures = self._temperature_batch(stamp, motor_temperature_degc)
        if measured_power is not None:
            power = _array("measured_power", measured_power, (len(stamp),))
            known = np.isfinite(power)
            meter = self._meter_batch(stamp[known], power=power[known])
        return self._step(_batch(JOINT_STATES_TOPIC, JOINT_STATE, stamp, rows), temperatures, meter)

    def push_temperatures(self, stamp_ns: ArrayLike, motor_temperature_degc: ArrayLike) -> None:
        """Take motor temperatures that have stamps of their own.

        Args:
            stamp_ns: When they were measured, shape () or (N,). [ns since 1970]
            motor_temperature_degc: In model order, NaN where unknown, shape (n,) or (N, n).
                [degC]

        Raises:
            ShapeError: If an array has another shape, or a stamp is beyond the year 2038.
        """
        stamp = _stamps(stamp_ns)
        self._step(None, self._temperature_batch(stamp, motor_temperature_degc), None)

    def push_meter(
        self,
        stamp_ns: ArrayLike,
        power: OptionalArray = None,
        *,
        energy: OptionalArray = None,
        interval: OptionalArray = None,
    ) -> None:
        """Take readings of the power meter that have stamps of their own.

        Args:
            stamp_ns: Of the reading, or the end of its interval, shape () or (N,).
                [ns since 1970]
            power: Instantaneous, or the mean over ``interval``, shape () or (N,). [W]
            energy: Reading of a counter, instead of power, shape () or (N,). [J]
            interval: Over which the power is a mean, shape () or (N,). [s]

        Raises:
            ShapeError: If an array has another shape, or neither power nor energy is given.
        """
        self._step(None, None, self._meter_batch(_stamps(stamp_ns), power, energy, interval))

    def flush(self) -> TimeSeries:
        """Return the power at what still waits, as at the end of a recording."""
        parts = [
            self.pipeline.step(None, self._temperatures.flush(), self._meter.flush()),
            self.pipeline.step(self._joints.flush()),
            self.pipeline.flush(),
        ]
        return self._table(parts)

    @property
    def account(self) -> EnergyAccount:
        """Registers, phases and the comparison with the meter."""
        return self.pipeline.account

    @property
    def energy(self) -> EnergyBreakdown:
        """Where the energy went so far."""
        return energy_of(self.account.registers, self.model.unmodelled)

    @property
    def rejected(self) -> dict[str, dict[str, int]]:
        """How many inputs were refused, by input and reason."""
        accounts = {
            "joint_states": (self._joints.rejections,),
            "temperatures": (self._temperatures.rejections, self.pipeline.friction.rejections),
            "meter": (self._meter.rejections, self.account.comparison.curve.rejections),
        }
        return {
            name: {reason: count for one in both for reason, count in one.rejected.items() if count}
            for name, both in accounts.items()
        }

    def _step(
        self, joints: RawBatch | None, temperatures: RawBatch | None, meter: RawBatch | None
    ) -> TimeSeries:
        output = self.pipeline.step(
            None if joints is None else self._joints.step(joints),
            None if temperatures is None else self._temperatures.step([temperatures]),
            None if meter is None else self._meter.step([meter]),
        )
        return self._table([output])

    def _table(self, outputs: list[Output]) -> TimeSeries:
        blocks = [output.power for output in outputs if output.power is not None]
        return power_table(blocks, self.model.joint_names, unmodelled=self.model.unmodelled)

    def _joint_states(self, velocity: bool, effort: bool) -> Encoder:
        if (velocity, effort) not in self._encoders:
            n_joints = len(self.model.joint_names)
            lengths = {
                "position": n_joints,
                "velocity": n_joints * velocity,
                "effort": n_joints * effort,
            }
            self._encoders[velocity, effort] = Encoder(
                JOINT_STATE, {"name": self.model.joint_names}, lengths
            )
        return self._encoders[velocity, effort]

    def _temperature_batch(self, stamp: Int, degc: ArrayLike) -> RawBatch:
        shape = (len(stamp), len(self.model.joint_names))
        values = _array("motor_temperature_degc", degc, shape)
        rows = self._degc.encode({**stamp_columns(stamp), "temperature_degc": values}, len(stamp))
        return _batch(TEMPERATURES_TOPIC, MOTOR_TEMPERATURES, stamp, rows)

    def _meter_batch(
        self,
        stamp: Int,
        power: OptionalArray = None,
        energy: OptionalArray = None,
        interval: OptionalArray = None,
    ) -> RawBatch:
        if (power is None) == (energy is None):
            raise ShapeError("neither power nor energy is given, or both", "one of them")
        meaning = (
            MeterMeaning.INSTANTANEOUS if interval is None else MeterMeaning.MEAN_OVER_INTERVAL
        )
        if energy is not None:
            meaning = MeterMeaning.CUMULATIVE
        given = {"power": power, "energy": energy, "interval": interval}
        rows = self._reading.encode(
            {
                **stamp_columns(stamp),
                **{
                    name: np.nan if values is None else _array(name, values, (len(stamp),))
                    for name, values in given.items()
                },
                "meaning": np.uint8(meaning),
                "location": np.uint8(self._location),
            },
            len(stamp),
        )
        return _batch(METER_TOPIC, POWER_READING, stamp, rows)


def _stamps(stamp_ns: ArrayLike) -> Int:
    stamp: NDArray[Any] = np.atleast_1d(np.asarray(stamp_ns))
    if stamp.ndim != 1 or stamp.dtype.kind not in "iu":
        raise ShapeError(
            f"the stamps have the shape {stamp.shape} and the type {stamp.dtype}",
            "integers in ns, shape () or (N,)",
        )
    return stamp.astype(np.int64)


def _array(name: str, values: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
    array: NDArray[np.float64] = np.asarray(values, dtype=np.float64)
    if array.shape == shape[1:]:
        array = array[None]
    if array.shape != shape:
        raise ShapeError(f"{name} has the shape {array.shape}", f"{shape}")
    return array


def _batch(topic: str, msgtype: str, stamp: Int, rows: NDArray[np.uint8]) -> RawBatch:
    """Messages of one length, one after the other in one buffer."""
    size = rows.shape[1]
    return RawBatch(
        topic,
        msgtype,
        stamp,
        rows.reshape(-1),
        np.arange(len(rows), dtype=np.int64) * size,
        np.repeat(np.int64(size), len(rows)),
    )
