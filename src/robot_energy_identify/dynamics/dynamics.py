"""Bodies, rotors and friction of a robot from recorded motion and motor torque.

The inverse dynamic identification model of paper B, section 4.3: the torque of every row is
linear in the parameters, so they follow by least squares. Parameters that no torque depends
on alone are grouped; what the recording does not excite is refused by name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.physics.counterbalance import AnySpring
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.results.base import Number, Result, Texts
from robot_energy.timeline.blocks import Float
from robot_energy_identify.blas_threads import one_thread
from robot_energy_identify.data.observations import Channels, Filters, Observations, Rows, observe
from robot_energy_identify.dynamics.base_parameters import BaseParameters, not_excited
from robot_energy_identify.dynamics.consistent import Prior, consistent_fit, link_prior
from robot_energy_identify.dynamics.torque_model import (
    NAMES,
    SIGNIFICANT,
    ParameterColumn,
    TorqueModel,
    open_springs,
    spring_columns,
    standard_columns,
)
from robot_energy_identify.dynamics.validation import (
    LeaveOneOut,
    TorqueError,
    check_channels,
    check_length,
    check_motion,
    estimate_delay,
    folds_of,
    poorly_known,
    predict_held_out,
    remarks,
    torque_error,
)
from robot_energy_identify.stats.cross_validation import GAIN, splits
from robot_energy_identify.stats.lag import NO_DELAY, Delay
from robot_energy_identify.stats.regression import (
    Fit,
    Method,
    autocorrelated,
    estimate,
    factor,
    fit,
    qr_r,
)
from robot_energy_identify.stats.systematic import (
    DEFAULT_LIMITS,
    TORQUE,
    SensorLimits,
    with_systematic,
)
from robot_energy_plan.motion import Trajectory

MIN_NOISE = 1e-3  # of the torque: no model of a robot is truer than that
UNCERTAINTY = 1.0  # of bodies of the URDF and rotors of the model file as a prior, share of each


class DynamicsSettings(Described):
    """How to identify."""

    columns: tuple[ParameterColumn, ...] = field(default_factory=standard_columns)
    method: Annotated[Method, "``ols``, ``wls`` or ``irls``."] = "wls"
    filters: Filters = field(default_factory=Filters)
    delay_span: Annotated[float, "Of the torque, that is looked for; 0: none. [s]"] = 0.005
    offset: Annotated[
        float,
        "Of a torque channel as a prior: one standard deviation as a share of the greatest torque "
        "measured on the axis. Assumed; what a current sensor may be off by. Gravity that little "
        "motion does not distinguish from an offset stays gravity. [-]",
    ] = 0.01
    sensors: SensorLimits = DEFAULT_LIMITS
    seen: Annotated[Rows | None, "Rows that were made before, as of `observe`."] = field(
        default=None, repr=False
    )


class Dynamics(Described):
    """What a recording says about a robot's dynamics."""

    model: RobotModel
    settings: DynamicsSettings
    base: Annotated[BaseParameters, "Groups of parameters that torque determines."]
    fit: Fit
    in_sample: Annotated[TorqueError, "On the data of the fit; no measure of accuracy."]
    delay: Delay
    columns: Annotated[tuple[ParameterColumn, ...], "Those of a model file, and offsets."]
    standard: Annotated[Float, "Physically consistent parameters of links and ``columns``."]
    exported: Annotated[Fit, "Least-squares fit of ``columns``, for the standard deviations."]
    exported_base: BaseParameters
    poorly_known: Annotated[
        tuple[str, ...],
        "Groups whose 95 % interval is wider than a body of that size makes likely.",
    ]
    notes: tuple[str, ...]
    observations: Observations

    @cached_property
    def torque_model(self) -> TorqueModel:
        """The links and what of `columns` a model file can hold, and offsets."""
        return TorqueModel.from_model(self.model, self.columns)

    @property
    def n_inertial(self) -> int:
        """How many of the groups are named by a parameter of a link."""
        return int((self.base.independent < 10 * len(self.model.joints)).sum())

    def held_out(self) -> TorqueError:
        """Torque error of the least-squares fit on contiguous folds held out."""
        rows = self.observations.with_columns(self.base.independent)
        return torque_error(rows, self._held_out(rows, self._values))

    def held_out_consistent(self) -> TorqueError:
        """Torque error of the model file, without offsets, on contiguous folds held out."""
        return torque_error(self.observations, self.predict_held_out())

    @one_thread
    def predict_held_out(self) -> Float:
        """Return joint torque (N, n) [N m] of a model file, each fold fitted to the others."""
        torque_model = self.torque_model
        rows = self.observations.with_names(torque_model.names)
        prior = _prior(self.model, torque_model, self.settings.offset, rows)
        weight = _whitening(rows, self.exported) * rows.used
        pairs = list(splits(folds_of(rows), round(rows.rate / self.settings.filters.cutoff)))
        # rows that belong to the same fits are compressed once, not once for every fit
        belongs, group = np.unique(
            np.stack([train for train, _ in pairs], axis=1), axis=0, return_inverse=True
        )
        parts = [
            np.column_stack(factor(*(each[group == g] for each in (*rows.equation, weight))))
            for g in range(len(belongs))
        ]
        predicted = np.full(rows.joint_torque.shape, np.nan)
        for number, (_, test) in enumerate(pairs):
            whole = qr_r(np.concatenate([parts[g] for g in np.flatnonzero(belongs[:, number])]))
            size = whole.shape[1] - 1
            found = _consistent(whole[:size, :size], whole[:size, size], prior, torque_model)
            predicted[test] = rows.regressor[test] @ torque_model.without_offsets(found)
        return predicted

    def held_out_given_bodies(self) -> TorqueError:
        """Torque error on contiguous folds held out, with the bodies that it began with.

        All else is refitted in every fold, so that the difference to `held_out_consistent` is what
        the identified bodies are worth.
        """
        torque_model = self.torque_model
        rows = self.observations.with_names(torque_model.names)
        links = torque_model.robot.link_parameters.ravel()
        rest = range(links.size, rows.regressor.shape[2])

        def estimator(train: Observations) -> Float:
            carried = train.regressor[:, :, : links.size] @ links
            part = replace(train.with_columns(rest), joint_torque=train.joint_torque - carried)
            return torque_model.without_offsets(np.concatenate([links, self._values(part)]))

        return torque_error(self.observations, self._held_out(rows, estimator))

    def _values(self, rows: Observations) -> Float:
        return estimate(rows.regressor, rows.joint_torque, self.settings.method, rows.used)[0]

    @one_thread
    def _held_out(self, rows: Observations, estimator: Callable[[Observations], Float]) -> Float:
        guard = 1.0 / self.settings.filters.cutoff
        return predict_held_out(rows, estimator, guard)

    @one_thread
    def rows_of(self, channels: Sequence[Channels]) -> Observations:
        """Return the rows of other recordings, filtered alike and with the delay undone."""
        whole = TorqueModel.from_model(self.model, self.settings.columns)
        rows = observe(channels, whole, self.settings.filters)
        return rows.advanced(self.delay.applied)

    def predict(self, rows: Observations) -> Float:
        """Return the joint torque (N, n) [N m] or [N] of a model file, sensors without offsets."""
        part = rows.with_names(self.torque_model.names)
        return part.regressor @ self.torque_model.without_offsets(self.standard)

    def motor_torque(self, motion: Trajectory) -> Float:
        """Return the motor torque (N, n) [N m] of the exported model, sensors without offsets."""
        regressor = self.torque_model.regressor(motion)
        values = self.torque_model.without_offsets(self.standard)
        torque = regressor @ values + self.torque_model.payload_torque(motion, regressor)
        return Drivetrain.from_model(self.model).motor_torque_from_joint(torque)

    def report(self, tests: Sequence[str] = ("held_out", "held_out_model_file")) -> DynamicsReport:
        """Return the result with some of its held-out errors."""
        values, half, std = self.fit.values, self.fit.interval(), self.fit.std
        errors = {
            "held_out": self.held_out,
            "held_out_model_file": self.held_out_consistent,
            "held_out_given_bodies": self.held_out_given_bodies,
        }
        return DynamicsReport(
            base_parameters=tuple(
                BaseParameter(
                    name,
                    self.base.expression(group),
                    float(values[group]),
                    float(std[group]),
                    float(half[group]),
                    bool(abs(values[group]) < half[group]),
                    name in self.poorly_known,
                    self.fit.parts_of(group),
                )
                for group, name in enumerate(self.base.labels)
            ),
            torque_error={test: errors[test]() for test in tests},
            delay=self.delay,
            across=None,
            notes=self.notes,
            result=self,
        )


class BaseParameter(Result):
    """One group of inertial, rotor and friction parameters."""

    name: Annotated[str, "Name of the standard parameter that stands for the group."]
    sum: Annotated[str, "The group."]
    value: Annotated[float, "Value in the unit of that parameter."]
    std: Annotated[Number, "Standard deviation."]
    interval_95: Annotated[Number, "Half width of the 95 % interval."]
    weakly_excited: Annotated[bool, "Whether the interval is wider than the value."]
    better_known_by_urdf: Annotated[bool, "Whether the URDF determines it more precisely."]
    parts: Annotated[dict[str, float], "Parts of the standard deviation, by cause."]


class DynamicsReport(Result, name="dynamics"):
    """Bodies, rotors and friction."""

    base_parameters: Annotated[tuple[BaseParameter, ...], "Groups that torque determines."]
    torque_error: Annotated[
        dict[str, TorqueError],
        "Error by test: ``held_out`` (least squares) and ``held_out_model_file`` (bodies that can "
        "exist); ``held_out_given_bodies`` where it was compared.",
    ]
    delay: Annotated[Delay, "Lag of the torque behind the positions."]
    across: Annotated[LeaveOneOut | None, "Errors of recordings held out whole; None for one."]
    notes: Annotated[Texts, "What the user should know, one sentence each."]
    result: Annotated[Dynamics, "The identification behind it."] = field(repr=False)


@one_thread
def identify_dynamics(
    channels: Sequence[Channels], model: RobotModel, settings: DynamicsSettings | None = None
) -> Dynamics:
    """Return a robot's dynamics as stretches of recordings without gaps, of one rate, show them.

    The bodies of the model are the prior. A counterbalance whose strength is assumed is
    identified, any other taken as known. What is not determined is refused by name.
    """
    settings = settings or DynamicsSettings()
    springs = open_springs(model)
    if springs:
        names = [model.joint_names[joint] for joint in springs]
        model = model.with_joints("counterbalance", dict.fromkeys(names))
        plain = identify_dynamics(channels, model, settings)
        columns = (*settings.columns, *spring_columns(springs))
        found = _identify(channels, model, replace(settings, columns=columns))
        _check_springs(springs, found, plain.held_out_consistent().joint)
        return found
    return _identify(channels, model, settings)


def _check_springs(springs: Mapping[int, AnySpring], found: Dynamics, plain: Float) -> None:
    """Refuse counterbalances that the recording cannot distinguish from weights and offsets.

    ``plain`` is the relative held-out error of each joint's torque without any, shape (n,). [-]
    """
    names, labels, fit = found.model.joint_names, found.base.labels, found.fit
    error = found.held_out_consistent().joint
    for joint, entry in springs.items():
        wanted = [f"{kind} {names[joint]}" for kind, _ in NAMES[entry.kind]]
        places = [labels.index(name) for name in wanted if name in labels]
        sure = 0.0
        if places:
            own = fit.values[places]
            sure = float(own @ np.linalg.solve(fit.covariance[np.ix_(places, places)], own))
        remedy = "give its figures from the data sheet, or leave the entry out"
        if sure < SIGNIFICANT:
            raise NotIdentifiableError(
                f"the counterbalance of {names[joint]} cannot be distinguished from weight and "
                f"offset of the torque (chi squared {sure:.3g})",
                f"at least {SIGNIFICANT:g}: wide and fast motion of this joint and those behind it",
                remedy,
            )
        if (
            entry.kind != "lever"
            and wanted[0] in labels
            and fit.values[labels.index(wanted[0])] < 0.0
        ):
            raise NotIdentifiableError(
                f"the {wanted[0]} comes out negative", "a spring that can exist", remedy
            )
        if not error[joint] < GAIN * plain[joint]:
            raise NotIdentifiableError(
                f"with a counterbalance held-out torque of {names[joint]} is off by "
                f"{100 * error[joint]:.2f} %, without one by {100 * plain[joint]:.2f} %",
                f"an error that is smaller by {100 * (1 - GAIN):.0f} %",
                remedy,
            )


def _identify(
    channels: Sequence[Channels], model: RobotModel, settings: DynamicsSettings
) -> Dynamics:
    check_channels(channels, model)
    whole = TorqueModel.from_model(model, settings.columns)
    rows = observe(channels, whole, settings.filters, settings.seen)
    check_motion(rows, whole.robot, settings.filters)
    base = whole.structure()
    independent = rows.with_columns(base.independent)
    check_length(independent)
    triangle, _ = factor(*independent.equation, independent.used.astype(np.float64))
    weak = not_excited(triangle, base.labels)
    if weak:
        raise NotIdentifiableError(
            f"the recording does not excite {', '.join(weak)}",
            "motion in which each of them makes a torque of its own",
            "record all joints moving at once, at several speeds and far apart",
        )
    gains = settings.sensors.std.torque, whole.transmission
    result = fit_rows(independent, settings.method, gains)
    del independent  # as large as all rows, and made again where it is needed
    delay = NO_DELAY
    if settings.delay_span > 0.0:
        guard = 1.0 / settings.filters.cutoff
        prior = _prior(model, whole, settings.offset, rows)
        weight = _whitening(rows, result).max(axis=0)
        delay = estimate_delay(rows, weight, prior, settings.delay_span, guard)
        if delay.applied:
            rows = rows.advanced(delay.applied)
            result = fit_rows(rows.with_columns(base.independent), settings.method, gains)
    columns = tuple(
        column for column in settings.columns if column.written or column.kind == "offset"
    )
    written = replace(whole, columns=columns)
    part = rows.with_names(written.names)
    exported, exported_base = result, base
    if part is not rows:
        exported_base = written.structure()
        exported = fit_rows(part.with_columns(exported_base.independent), settings.method, gains)
    prior = _prior(model, written, settings.offset, part)
    weight = _whitening(part, exported) * part.used
    standard = _consistent(*factor(*part.equation, weight), prior, written)
    in_sample = torque_error(rows, rows.joint_torque - result.residual)
    poor = poorly_known(base, result, link_prior(whole.robot.link_parameters, 1.0))
    return Dynamics(
        model,
        settings,
        base,
        result,
        in_sample,
        delay,
        columns,
        standard,
        exported,
        exported_base,
        poor,
        tuple(remarks(delay, settings.delay_span, in_sample, result, poor)),
        rows,
    )


def fit_rows(
    rows: Observations, method: Method = "wls", gains: tuple[float, Float] | None = None
) -> Fit:
    """Return the parameters of rows and their covariance.

    Args:
        gains: Standard deviation of the gain of each motor's torque [-], and the transmission,
            shape (n, n) [-]; None: there is no such error.
    """
    covariance = autocorrelated(rows.segment)
    found = fit(rows.regressor, rows.joint_torque, rows.names, covariance, method, rows.used)
    if gains is None:
        return found
    std, transmission = gains
    motor = (rows.joint_torque + rows.payload_torque) @ np.linalg.inv(transmission)
    changes = [std * motor[:, [k]] * transmission[k] for k in range(len(transmission))]
    return with_systematic(found, rows.regressor, {TORQUE: changes})


def _prior(
    model: RobotModel, torque_model: TorqueModel, offset: float, rows: Observations
) -> Prior:
    """The URDF's bodies, the model file's rotors, small offsets; nothing else is known."""
    links = link_prior(torque_model.robot.link_parameters, UNCERTAINTY)
    greatest = np.abs(rows.joint_torque[rows.compared]).max(axis=0)
    values, std = np.zeros(len(torque_model.extra)), np.full(len(torque_model.extra), np.inf)
    for place, (column, owner, _) in enumerate(torque_model.extra):
        joint = model.joints[owner]
        rotor = joint.rotor_inertia.value * joint.gear_ratio.value**2
        if column.kind == "rotor_inertia":
            values[place] = rotor
            std[place] = UNCERTAINTY * rotor if rotor > 0.0 else np.inf
        elif column.owner == "sensor":
            std[place] = max(offset * greatest[owner], np.finfo(float).tiny)
    return Prior(np.concatenate([links.values, values]), np.concatenate([links.std, std]))


def _whitening(rows: Observations, result: Fit) -> Float:
    """Weights that count only independent rows, shape (N, n)."""
    used = result.weight > 0.0
    count = np.maximum(used.sum(axis=0), 1)
    share = np.sqrt(result.independent / count)
    torque = np.sqrt((rows.joint_torque**2 * used).sum(axis=0) / count)
    return used * share / np.maximum(result.noise, MIN_NOISE * torque)


def _consistent(triangle: Float, target: Float, prior: Prior, torque_model: TorqueModel) -> Float:
    extra = enumerate(torque_model.extra, torque_model.n_links)
    positive = [place for place, (column, _, _) in extra if column.positive]
    return consistent_fit(triangle, target, prior, torque_model.robot.n_joints, positive)
