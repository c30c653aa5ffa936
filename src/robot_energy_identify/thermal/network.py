"""Fit of the thermal network of one motor: a free run from the first reading is compared.

The measured temperature enters at the start alone; so what is fitted is what runs without a
sensor. One node or two: the second must predict held-out temperatures better. The fit sees windows
of 10 s, or of a sixtieth of a run that lasts less than 10 min, as a small motor needs.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import numpy as np

from robot_energy.condition.thermal_state import AMBIENT_STD, WINDOW
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import LogFormatError, NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.model.figure import Figure
from robot_energy.model.joint import JointThermal
from robot_energy.physics.motor_heat import MotorHeat
from robot_energy.timeline.blocks import NANOSECOND, Float, Int, Rows
from robot_energy_identify.blas_threads import one_thread
from robot_energy_identify.bounds import identified
from robot_energy_identify.data.recordings import Recording
from robot_energy_identify.stats.cross_validation import GAIN, rms_of

if TYPE_CHECKING:
    from robot_energy_logs.recording import LogBlock

MIN_RISE = 3.0  # K between the coldest and the warmest reading
MIN_WINDOWS = 60
LONG = 600.0  # s of windows in all, below which they must last for several
TIME_CONSTANTS = 5.0  # of the motor
MIN_GAIN = 0.5  # K of held-out error, as a thermometer is off, that a second node must save
TRAIN_SHARE = 0.6  # of the only run; the rest is the test
READING_STD = 0.5  # K
CORRELATED = 6  # windows whose errors are alike: one minute of 10 s each
START, START_SPREAD = 0.8, 0.3  # structure above the ambient at the start, over the motor above it
PRIORS = {
    "motor_time": (np.log(900.0), 1.0),
    "structure_time": (np.log(3600.0), 0.7),
    "structure_ratio": (np.log(3.0), 1.0),
    "share": (0.3, 0.3),
}
"""Middle and spread: time constants [s] and the ratio of capacities as logarithms."""
ONE, TWO = ("motor_time", "motor", "idle"), (
    *("motor_time", "motor", "idle"),
    *("structure_time", "structure_ratio", "share"),
)  # fmt: skip


WINDOWS = 60  # of a run at least,
SHORTEST = 1.0  # s, where it is as long as sixty of these
MAX_GAP = 600.0  # s without samples, beyond which another run begins


class ThermalRun(Rows):
    """One motor during one run, in windows; those without samples have no heat."""

    time: Annotated[Float, "Start of each window, shape (N,). [s]"]
    drive_heat: Annotated[
        Float,
        "Mean loss of motor and inverter, shape (N,). [W], or of a log the squared motor current. "
        "[A^2]",
    ]
    friction_heat: Annotated[Float, "Mean friction power, shape (N,). [W]"]
    awake: Annotated[Float, "Share of the window with samples, shape (N,). [-]"]
    motor_temperature_degc: Annotated[
        Float, "Last reading in the window, NaN for none, shape (N,). [degC]"
    ]
    start_degc: Annotated[float, "First reading. [degC]"]
    window: Annotated[float, "Length of a window. [s]"] = WINDOW
    age: Annotated[
        Float | None,
        "Of the reading at the end of its window, as a share of the window; None: 0, shape (N,). "
        "[-]",
    ] = None


def without_networks(model: RobotModel) -> RobotModel:
    """Return a model that estimates no temperature, so that readings alone are seen."""
    return model.with_joints("thermal", dict.fromkeys(model.joint_names))


def runs_of_recordings(recordings: Sequence[Recording], joint: int) -> list[ThermalRun]:
    """Return the runs of one motor in recordings of the same robot.

    Args:
        recordings: Run with a model without thermal networks.
    """
    runs: list[ThermalRun] = []
    for recording in recordings:
        power = recording.power
        runs += _runs(
            power.stamp_ns,
            power.drive_loss[:, joint],
            power.friction_power[:, joint],
            power.motor_temperature_degc[:, joint],
        )
    return runs


def runs_of_log(blocks: Sequence[LogBlock], joint: int) -> list[ThermalRun]:
    """Return the runs of one motor in a log with currents and temperatures."""
    rows = blocks[0].concatenate(blocks)
    heat = rows.effort[:, joint] ** 2
    degc = rows.motor_temperature_degc[:, joint]
    for key, values in (("effort", heat), ("temperature", degc)):
        if not np.isfinite(values).any():
            raise LogFormatError(
                f"the log has no {key} of joint {joint + 1}",
                "motor currents and motor temperatures",
                f"name its column under joints.{key} in the mapping",
            )
    return _runs(rows.stamp_ns, heat, np.zeros_like(heat), degc, rows.run)


def _runs(
    stamp_ns: Int, drive: Float, friction: Float, degc: Float, run: Int | None = None
) -> list[ThermalRun]:
    """Cut samples at long gaps and between runs, and sum them over windows."""
    cut = np.abs(np.diff(stamp_ns)) > MAX_GAP / NANOSECOND
    cut |= False if run is None else np.diff(run) != 0
    cuts = np.flatnonzero(cut) + 1
    runs: list[ThermalRun] = []
    for rows in np.split(np.arange(len(stamp_ns)), cuts):
        time = (stamp_ns[rows] - stamp_ns[rows[0]]) * NANOSECOND
        known = np.flatnonzero(np.isfinite(degc[rows]))
        if not len(known):
            continue
        time, rows = time[known[0] :] - time[known[0]], rows[known[0] :]
        length = min(WINDOW, max(float(time[-1]) / WINDOWS, SHORTEST))
        window = (time // length).astype(np.int64)
        count = int(window[-1]) + 1
        duration = np.minimum(np.diff(time, append=time[-1]), length)
        awake = np.bincount(window, duration, count) / length
        heats = [
            np.bincount(window, np.nan_to_num(heat[rows]) * duration, count) / length
            for heat in (drive, friction)
        ]
        readings = np.full(count, np.nan)
        read = np.isfinite(degc[rows])
        readings[window[read]] = degc[rows][read]  # the last one stays
        new = np.flatnonzero(read)[1:][np.diff(degc[rows][read]) != 0.0]
        age = np.zeros(count)  # one that says the same again is as good as new
        age[window[new]] = window[new] + 1 - time[new] / length
        starts, first = np.arange(count) * length, float(degc[rows[0]])
        runs.append(ThermalRun(starts, heats[0], heats[1], awake, readings, first, length, age))
    return runs


class ThermalFit(Described):
    """Thermal network of one motor."""

    name: Annotated[str, "Of the joint."]
    network: Annotated[JointThermal, "As in a model file."]
    rms: Annotated[float, "Error of a free run on what the fit has not seen. [K]"]
    held_rms: Annotated[float, "The same where the first reading is held instead. [K]"]
    held_out: Annotated[str, "What that was: ``runs`` or ``end of the run``."]
    orders: Annotated[dict[str, float], "Held-out error by the number of nodes. [K]"]
    runs: Annotated[int, "Runs of the fit."]
    hours: Annotated[float, "Their length in all. [h]"]
    range_degc: Annotated[tuple[float, float], "Of the readings. [degC]"]

    @property
    def motor_time_constant(self) -> float:
        """C_m over G_m. [s]"""
        return self.network.capacity.value / self.network.conductance.value


def ambient_of(runs: Sequence[Sequence[ThermalRun]]) -> float:
    """Return the coldest first reading of all motors: a robot that starts cold."""
    return min(run.start_degc for motor in runs for run in motor)


@one_thread
def fit_network(
    name: str, runs: Sequence[ThermalRun], ambient_degc: float, source: str = ""
) -> ThermalFit:
    """Return the thermal network of one motor.

    Args:
        ambient_degc: Of the air. [degC]

    Raises:
        NotIdentifiableError: If there is too little, the motor hardly warms, or the network
            predicts no better than its first reading.
    """
    if not runs or sum(map(len, runs)) < MIN_WINDOWS:
        raise _too_short(name, runs)
    readings = np.concatenate([run.motor_temperature_degc for run in runs])
    low, high = float(np.nanmin(readings)), float(np.nanmax(readings))
    if high - low < MIN_RISE:
        raise NotIdentifiableError(
            f"{name} warms by {high - low:.1f} K", f"at least {MIN_RISE:g} K", "record a cold start"
        )
    orders: dict[str, float] = {}
    errors: dict[str, tuple[Float, Float, Float]] = {}
    for label, keys in (("one node", ONE), ("two nodes", TWO)):
        errors[label] = _held_out(runs, keys, ambient_degc)
        orders[label] = rms_of(errors[label][0] - errors[label][1])
    better = orders["one node"] - orders["two nodes"] >= MIN_GAIN
    order = "two nodes" if better else "one node"
    keys = ONE if order == "one node" else TWO
    values, covariance = _fit(runs, keys, ambient_degc)
    if _length(runs) < min(LONG, TIME_CONSTANTS * float(np.exp(values[0]))):
        raise _too_short(name, runs)
    _, measured, held = errors[order]
    rms, held_rms = orders[order], rms_of(held - measured)
    if not rms < GAIN * held_rms:
        raise NotIdentifiableError(
            f"a free run of {name} is {rms:.2f} K off on what the fit has not seen, and its first "
            f"reading, held, is {held_rms:.2f} K off",
            "a network that predicts better",
            "record longer, with work and rest, and identify friction and drives first",
        )
    return ThermalFit(
        name,
        _entry(keys, values, covariance, rms, source),
        rms,
        held_rms,
        "runs" if len(runs) > 1 else "end of the run",
        orders,
        len(runs),
        _length(runs) / 3600.0,
        (low, high),
    )


def _length(runs: Sequence[ThermalRun]) -> float:
    """Time of all windows. [s]"""
    return sum(len(run) * run.window for run in runs)


def _too_short(name: str, runs: Sequence[ThermalRun]) -> NotIdentifiableError:
    return NotIdentifiableError(
        f"{name} has {_length(runs):.0f} s with temperatures",
        f"at least {LONG:.0f} s, or {TIME_CONSTANTS:g} time constants of a small motor",
        "record longer, from a cold start",
    )


def fit_networks(
    names: Sequence[str],
    runs: Sequence[Sequence[ThermalRun]],
    ambient_degc: float | None = None,
    source: str = "",
) -> tuple[float, list[ThermalFit], list[str]]:
    """Return the temperature of the air [degC], the networks, and why other motors have none.

    Args:
        ambient_degc: Of the air; None: see `ambient_of`. [degC]
    """
    if not any(runs):
        raise NotIdentifiableError(
            "no motor temperature is known", "recordings with temperatures",
            "name their topic with --inputs",
        )  # fmt: skip
    ambient = ambient_of(runs) if ambient_degc is None else ambient_degc
    fits: list[ThermalFit] = []
    refused: list[NotIdentifiableError] = []
    for name, motor in zip(names, runs, strict=True):
        try:
            fits.append(fit_network(name, motor, ambient, source))
        except NotIdentifiableError as error:
            refused.append(error)
    if not fits:
        raise refused[0]
    return ambient, fits, [str(error) for error in refused]


def with_networks(model: RobotModel, fits: Sequence[ThermalFit], ambient_degc: float) -> RobotModel:
    """Return a model with identified thermal networks; the other motors keep theirs.

    Args:
        ambient_degc: Of the air during the recordings. [degC]
    """
    found = model.with_joints("thermal", {fit.name: fit.network for fit in fits})
    return with_ambient(found, ambient_degc)


def with_ambient(model: RobotModel, ambient_degc: float | None) -> RobotModel:
    """Return a model with the temperature of the air of its recordings.

    Args:
        ambient_degc: None leaves it. [degC]
    """
    if ambient_degc is None:
        return model
    air = Figure(value=ambient_degc, tag="assumed", std=AMBIENT_STD, source="as in the recordings")
    temperature = model.temperature.model_copy(update={"ambient_degc": air})
    return model.changed(temperature=temperature)


def free_run(heat: MotorHeat, run: ThermalRun, ambient_degc: float, start: float = START) -> Float:
    """Return the temperature of a motor at the reading of every window, from the first one on.

    Args:
        heat: Its network, n = 1.
        ambient_degc: Of the air. [degC]
        start: Structure above the ambient, as a share of the motor above it. [-]
    """
    from scipy.signal import lfilter

    share = float(heat.share[0])
    motor = run.drive_heat + share * run.friction_heat + float(heat.idle[0]) * run.awake
    power = np.stack([motor, (1.0 - share) * run.friction_heat])
    transition, gain = (part[0] for part in heat.step(run.window))
    decay, modes = (np.asarray(part, dtype=np.float64) for part in np.linalg.eig(transition))
    above = run.start_degc - ambient_degc
    begin = np.linalg.solve(modes, np.array([above, start * above]))
    driven = np.asarray(np.linalg.solve(modes, gain @ power), dtype=np.float64)
    above_ambient: list[Float] = [
        modes[0, mode]
        * lfilter([1.0], [1.0, -decay[mode]], driven[mode], zi=[decay[mode] * begin[mode]])[0]
        for mode in range(2)
    ]
    ends = ambient_degc + np.sum(above_ambient, axis=0)
    if run.age is None:
        return ends
    return ends - run.age * np.diff(ends, prepend=run.start_degc)


def _heat(keys: Sequence[str], values: Float) -> MotorHeat:
    """The network of fitted values; see `ONE` and `TWO`."""
    at = dict(zip(keys, values.tolist(), strict=True))
    capacity = np.exp(at["motor"])
    inner = 1.0 / np.exp(at["motor_time"])
    idle = at["idle"] * capacity * inner  # idle is the rise that it makes [K]
    if len(keys) == len(ONE):
        figures = (inner, 0.0, 1.0, 1.0 / capacity, 0.0, 1.0, idle)
    else:
        larger = capacity * np.exp(at["structure_ratio"])
        outer = 1.0 / np.exp(at["structure_time"])
        figures = (
            *(inner, inner * capacity / larger, outer),
            *(1.0 / capacity, 1.0 / larger, at["share"], idle),
        )
    return MotorHeat(*(np.array([float(figure)]) for figure in figures))


def _fit(runs: Sequence[ThermalRun], keys: Sequence[str], ambient: float) -> tuple[Float, Float]:
    """Values of the keys and their covariance."""
    from scipy.optimize import least_squares

    scale = READING_STD * np.sqrt(CORRELATED)
    count = len(keys)
    size = np.log(
        max(float(np.mean([np.mean(run.drive_heat + run.friction_heat) for run in runs])), 1e-6)
        * 900.0
        / 10.0
    )
    middle = np.array([PRIORS.get(key, (size if key == "motor" else 0.0, 0))[0] for key in keys])
    spread = np.array([PRIORS.get(key, (0, 2.0 if key == "motor" else 10.0))[1] for key in keys])
    low = np.array([{"idle": 0.0, "share": 0.0}.get(key, -np.inf) for key in keys])
    high = np.array([{"share": 1.0}.get(key, np.inf) for key in keys])

    def residual(x: Float) -> Float:
        heat = _heat(keys, x[:count])
        parts = [
            (free_run(heat, run, ambient, start) - run.motor_temperature_degc) / scale
            for run, start in zip(runs, x[count:], strict=True)
        ]
        error = np.concatenate(parts)
        prior = np.concatenate([(x[:count] - middle) / spread, (x[count:] - START) / START_SPREAD])
        return np.concatenate([error[np.isfinite(error)], prior])

    first = np.concatenate([middle, np.full(len(runs), START)])
    first[: len(keys)] = np.clip(first[:count], low + 1e-3, high - 1e-3)
    bounds = (np.append(low, np.zeros(len(runs))), np.append(high, np.full(len(runs), 1.2)))
    found = least_squares(residual, first, bounds=bounds, x_scale="jac", max_nfev=60)
    noise = max(float(np.mean(found.fun**2)) * CORRELATED, 1.0)
    slopes = np.asarray(found.jac, dtype=np.float64)
    covariance = np.linalg.pinv(slopes.T @ slopes) * noise
    return np.asarray(found.x[:count]), covariance[:count, :count]


def _held_out(
    runs: Sequence[ThermalRun], keys: Sequence[str], ambient: float
) -> tuple[Float, Float, Float]:
    """Predicted, measured and held temperatures of windows that the fits have not seen."""
    parts: list[tuple[Float, Float, Float]] = []
    if len(runs) == 1:
        row = int(TRAIN_SHARE * len(runs[0]))
        train, tests = [[runs[0][:row]]], [(runs[0], row)]
    else:
        train = [[run for run in runs if run is not test] for test in runs]
        tests = [(run, 0) for run in runs]
    for seen, (test, row) in zip(train, tests, strict=True):
        values, _ = _fit(seen, keys, ambient)
        free = free_run(_heat(keys, values), test, ambient)
        measured = test.motor_temperature_degc
        known = np.flatnonzero(np.isfinite(measured))
        known = known[known >= row]
        last = measured[known[0]] if len(known) and row else test.start_degc
        parts.append((free[known], measured[known], np.full(len(known), last)))
    predicted, measured, held = (np.concatenate(column) for column in zip(*parts, strict=True))
    return predicted, measured, held


def _entry(
    keys: Sequence[str], values: Float, covariance: Float, rms: float, source: str
) -> JointThermal:
    """The entry of a model file, its deviations by the slopes of each figure."""

    def figures(x: Float) -> Float:
        heat = _heat(keys, x)
        capacity = 1.0 / heat.motor[0]
        row = [capacity, heat.inner[0] * capacity, heat.idle[0]]
        if len(keys) == len(TWO):
            larger = 1.0 / heat.structure[0]
            row += [larger, heat.outer[0] * larger, heat.share[0]]
        return np.array(row)

    steps = 1e-4 * np.eye(len(values))
    slopes = np.stack([(figures(values + s) - figures(values - s)) / 2e-4 for s in steps], axis=1)
    std = np.sqrt(np.maximum(np.diag(slopes @ covariance @ slopes.T), 0.0)).tolist()
    found = [
        identified(value, deviation, source)
        for value, deviation in zip(figures(values).tolist(), std, strict=True)
    ]
    entry = JointThermal(capacity=found[0], conductance=found[1], idle=found[2], std=rms)
    if len(found) > len(ONE):
        keys = ("structure_capacity", "structure_conductance", "friction_to_motor")
        entry = entry.model_copy(update={**dict(zip(keys, found[3:], strict=True))})
    return entry
