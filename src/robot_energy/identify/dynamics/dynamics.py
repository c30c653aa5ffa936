"""Bodies, rotors and friction of a robot from recorded motion and motor torque.

The inverse dynamic identification model of paper B, section 4.3: the torque of every row is
linear in the parameters, so they follow by least squares. Parameters that no torque depends
on alone are grouped; what the recording does not excite is refused by name.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from robot_energy.blocks import Float
from robot_energy.errors import NotIdentifiableError
from robot_energy.identify.data.observations import (
    Filters,
    Observations,
    observe,
    parameter_names,
    regressor_of,
)
from robot_energy.identify.data.signals import Channels, Motion
from robot_energy.identify.dynamics.base_parameters import (
    BaseParameters,
    base_parameters,
    not_excited,
)
from robot_energy.identify.dynamics.columns import Column, standard_columns
from robot_energy.identify.dynamics.consistent import Prior, consistent_fit, link_prior
from robot_energy.identify.dynamics.sufficiency import (
    check_channels,
    check_length,
    check_motion,
    poorly_known,
    remarks,
)
from robot_energy.identify.dynamics.torque_delay import estimate_delay
from robot_energy.identify.dynamics.validation import TorqueError, predict_held_out, torque_error
from robot_energy.identify.stats.lag import NO_DELAY, Delay
from robot_energy.identify.stats.regression import (
    Fit,
    Method,
    autocorrelated,
    estimate,
    factor,
    fit,
)
from robot_energy.identify.stats.threads import one_thread
from robot_energy.model import RobotModel
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.rigid_body import Robot

SAMPLES = 200  # random motions that show the structure of the robot
LEAST_NOISE = 1e-3  # of the torque: no model of a robot is truer than that


@dataclass(frozen=True)
class DynamicsSettings:
    """How to identify.

    Attributes:
        columns: What is fitted beside the links.
        method: ``ols``, ``wls`` or ``irls``.
        filters: Of the channels.
        delay_span: Delays of the torque up to this are looked for, 0: none. [s]
        folds: Contiguous folds of the validation.
        uncertainty: Of the URDF's bodies as a prior, share of each figure; the rotor
            inertias of the model file likewise. [-]
        offset: Of a torque channel as a prior: one standard deviation as a share of the
            greatest torque measured on the axis. Assumed; what a current sensor may be off
            by. Gravity that little motion does not tell from an offset stays gravity. [-]
    """

    columns: tuple[Column, ...] = field(default_factory=standard_columns)
    method: Method = "wls"
    filters: Filters = field(default_factory=Filters)
    delay_span: float = 0.005
    folds: int = 5
    uncertainty: float = 1.0
    offset: float = 0.01


@dataclass(frozen=True)
class Dynamics:
    """What a recording tells about a robot's dynamics.

    Attributes:
        model: The model it began with.
        settings: How it was identified.
        base: Groups of parameters that torque tells.
        fit: Values of the groups.
        in_sample: Torque error on the data of the fit; no measure of accuracy.
        delay: Between torque and positions.
        columns: Those that a model file can hold, and offsets.
        standard: Physically consistent parameters of links and ``columns``.
        exported: Least-squares fit of ``columns``, for the standard deviations.
        exported_base: Its groups.
        poorly_known: Groups of which the recording tells less than the prior: their 95 %
            interval is wider than a body of that size makes likely.
        notes: What the user should know.
        observations: The rows, every parameter, delay undone.
    """

    model: RobotModel
    settings: DynamicsSettings
    base: BaseParameters
    fit: Fit
    in_sample: TorqueError
    delay: Delay
    columns: tuple[Column, ...]
    standard: Float
    exported: Fit
    exported_base: BaseParameters
    poorly_known: tuple[str, ...]
    notes: tuple[str, ...]
    observations: Observations

    @property
    def n_inertial(self) -> int:
        """How many of the groups are named by a parameter of a link."""
        return int((self.base.independent < 10 * len(self.model.joints)).sum())

    def held_out(self) -> TorqueError:
        """Torque error of the least-squares fit on contiguous folds held out."""
        rows = self.observations.with_columns(self.base.independent)
        return torque_error(rows, self._held_out(rows, self._values))

    def held_out_consistent(self) -> TorqueError:
        """Torque error of the model file on contiguous folds held out.

        The physically consistent fit without the offsets of the torque channels, which a
        model file does not hold.
        """
        return torque_error(self.observations, self.predict_held_out())

    def predict_held_out(self) -> Float:
        """Return what the model file says of every contiguous fold, fitted to the others.

        Returns:
            Joint torque at the rows of `observations`, shape (N, n). [N m] or [N]
        """
        robot, transmission = mechanics(self.model)
        rows = _restricted(self.observations, robot, transmission, self.columns)
        prior = _prior(self.model, robot, self.columns, self.settings, rows)
        weight = _whitening(rows, self.exported)

        def estimator(train: Observations) -> Float:
            values = _consistent(train, weight, prior, self.columns, robot, transmission)
            return _without_offsets(values, rows.names)

        return self._held_out(rows, estimator)

    def held_out_given_bodies(self) -> TorqueError:
        """Torque error on contiguous folds held out, with the bodies that it began with.

        Rotors, friction and offsets are refitted in every fold and offsets left out of the
        prediction, so that the difference to `held_out_consistent` is what the identified
        bodies are worth.
        """
        robot, transmission = mechanics(self.model)
        rows = _restricted(self.observations, robot, transmission, self.columns)
        links = robot.link_parameters.ravel()
        rest = range(links.size, rows.regressor.shape[2])

        def estimator(train: Observations) -> Float:
            carried = train.regressor[:, :, : links.size] @ links
            part = replace(train.with_columns(rest), joint_torque=train.joint_torque - carried)
            return _without_offsets(np.concatenate([links, self._values(part)]), rows.names)

        return torque_error(self.observations, self._held_out(rows, estimator))

    def _values(self, rows: Observations) -> Float:
        return estimate(rows.regressor, rows.joint_torque, self.settings.method, rows.used)[0]

    @one_thread
    def _held_out(self, rows: Observations, estimator: Callable[[Observations], Float]) -> Float:
        guard = 1.0 / self.settings.filters.cutoff
        return predict_held_out(rows, estimator, self.settings.folds, guard)

    @one_thread
    def rows_of(self, channels: Sequence[Channels]) -> Observations:
        """Return the rows of other recordings, filtered alike and with the delay undone.

        Args:
            channels: Stretches without gaps, at any one rate.
        """
        robot, transmission = mechanics(self.model)
        columns, filters = self.settings.columns, self.settings.filters
        rows = observe(channels, robot, transmission, columns, filters)
        return rows.advanced(self.delay.applied)

    def predict(self, rows: Observations) -> Float:
        """Return what the model file says of rows, offsets of the sensor left out.

        Args:
            rows: Of `rows_of`.

        Returns:
            Joint torque, shape (N, n). [N m] or [N]
        """
        robot, transmission = mechanics(self.model)
        part = _restricted(rows, robot, transmission, self.columns)
        return part.regressor @ _without_offsets(self.standard, part.names)

    def motor_torque(self, motion: Motion) -> Float:
        """Motor torque that the exported model must give, offsets of the sensor left out.

        Args:
            motion: Joint motion.

        Returns:
            Motor side, shape (N, n). [N m]
        """
        robot, transmission = mechanics(self.model)
        regressor = regressor_of(motion, robot, transmission, self.columns)
        names = parameter_names(robot, transmission, self.columns)
        values = _without_offsets(self.standard, names)
        payload = robot.joint_torque(
            motion.joint_position, motion.joint_velocity, motion.joint_acceleration
        ) - (regressor[:, :, : 10 * robot.n_joints] @ robot.link_parameters)
        drivetrain = Drivetrain.from_model(self.model)
        return drivetrain.motor_torque_from_joint(regressor @ values + payload)


@one_thread
def identify_dynamics(
    channels: Sequence[Channels], model: RobotModel, settings: DynamicsSettings | None = None
) -> Dynamics:
    """Identify a robot's dynamics.

    Args:
        channels: Stretches of recordings without gaps, one rate for all.
        model: Kinematics, drivetrain, payload, and bodies as the prior.
        settings: How; the defaults suit industrial arms.

    Returns:
        The result.

    Raises:
        NotIdentifiableError: If the recording does not tell the parameters; names them and
            what to record instead.
    """
    settings = settings or DynamicsSettings()
    check_channels(channels, model)
    robot, transmission = mechanics(model)
    rows = observe(channels, robot, transmission, settings.columns, settings.filters)
    check_motion(rows, robot, settings.filters)
    base = structure(robot, transmission, settings.columns)
    independent = rows.with_columns(base.independent)
    check_length(independent)
    weak = not_excited(independent.regressor[independent.used], base.labels)
    if weak:
        raise NotIdentifiableError(
            f"the recording does not excite {', '.join(weak)}",
            "motion in which each of them makes a torque of its own",
            "record all joints moving at once, at several speeds and far apart",
        )
    result = fit_rows(independent, settings.method)
    delay = NO_DELAY
    if settings.delay_span > 0.0:
        guard = 1.0 / settings.filters.cutoff
        prior = _prior(model, robot, settings.columns, settings, rows)
        weight = _whitening(rows, result).max(axis=0)
        delay = estimate_delay(rows, weight, prior, settings.delay_span, settings.folds, guard)
        if delay.applied:
            rows = rows.advanced(delay.applied)
            independent = rows.with_columns(base.independent)
            result = fit_rows(independent, settings.method)
    columns = tuple(
        column for column in settings.columns if column.written or column.kind == "offset"
    )
    if parameter_names(robot, transmission, columns) == rows.names:
        exported, exported_base = result, base
    else:
        exported_base = structure(robot, transmission, columns)
        part = _restricted(rows, robot, transmission, columns)
        exported = fit_rows(part.with_columns(exported_base.independent), settings.method)
    part = _restricted(rows, robot, transmission, columns)
    prior = _prior(model, robot, columns, settings, part)
    standard = _consistent(part, _whitening(part, exported), prior, columns, robot, transmission)
    in_sample = torque_error(independent, independent.regressor @ result.values)
    poor = poorly_known(base, result, link_prior(robot.link_parameters, 1.0))
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


def fit_rows(rows: Observations, method: Method = "wls") -> Fit:
    """Fit the parameters of the rows' columns, which must be independent."""
    covariance = autocorrelated(rows.segment)
    return fit(rows.regressor, rows.joint_torque, rows.names, covariance, method, rows.used)


def structure(robot: Robot, transmission: Float, columns: Sequence[Column]) -> BaseParameters:
    """Return the groups of parameters that any motion of a robot can tell.

    Args:
        robot: Its kinematics.
        transmission: Motor turns per joint turn, shape (n, n).
        columns: What is fitted beside the links.
    """
    random = np.random.default_rng(0)
    lower = np.maximum(robot.limits.lower, -np.pi)
    upper = np.minimum(robot.limits.upper, np.pi)
    shape = (SAMPLES, robot.n_joints)
    motion = Motion(random.uniform(lower, upper, shape), *random.normal(size=(2, *shape)))
    regressor = regressor_of(motion, robot, transmission, columns)
    names = parameter_names(robot, transmission, columns)
    return base_parameters(regressor.reshape(-1, len(names)), names)


def mechanics(model: RobotModel) -> tuple[Robot, Float]:
    """Return the rigid bodies of a model, and motor turns per joint turn, shape (n, n)."""
    return Robot.from_model(model), Drivetrain.from_model(model).transmission


def _restricted(
    rows: Observations, robot: Robot, transmission: Float, columns: Sequence[Column]
) -> Observations:
    """Rows with the columns that a model file can hold."""
    names = parameter_names(robot, transmission, columns)
    if names == rows.names:
        return rows
    return rows.with_columns([rows.names.index(name) for name in names])


def _prior(
    model: RobotModel,
    robot: Robot,
    columns: Sequence[Column],
    settings: DynamicsSettings,
    rows: Observations,
) -> Prior:
    """The URDF's bodies, the model file's rotors, small offsets; nothing else is known."""
    links = link_prior(robot.link_parameters, settings.uncertainty)
    values, std = [links.values], [links.std]
    ratio = np.array([joint.gear_ratio.value for joint in model.joints])
    rotor = np.array([joint.rotor_inertia.value for joint in model.joints]) * ratio**2
    greatest = np.abs(rows.joint_torque[rows.compared]).max(axis=0)
    transmission = Drivetrain.from_model(model).transmission
    for column in columns:
        count = len(column.joints(transmission))
        centre, width = np.zeros(count), np.full(count, np.inf)
        if column.kind == "rotor_inertia":
            centre, width = rotor, np.where(rotor > 0.0, settings.uncertainty * rotor, np.inf)
        elif column.kind == "offset":
            width = np.maximum(settings.offset * greatest, np.finfo(float).tiny)
        values.append(centre)
        std.append(width)
    return Prior(np.concatenate(values), np.concatenate(std))


def _without_offsets(values: Float, names: Sequence[str]) -> Float:
    """Parameters as a model file holds them."""
    return np.where([name.startswith("offset ") for name in names], 0.0, values)


def _whitening(rows: Observations, result: Fit) -> Float:
    """Weights that count only independent rows, shape (N, n)."""
    used = result.weight > 0.0
    count = np.maximum(used.sum(axis=0), 1)
    share = np.sqrt(result.independent / count)
    torque = np.sqrt((rows.joint_torque**2 * used).sum(axis=0) / count)
    return used * share / np.maximum(result.noise, LEAST_NOISE * torque)


def _consistent(
    rows: Observations,
    weight: Float,
    prior: Prior,
    columns: Sequence[Column],
    robot: Robot,
    transmission: Float,
) -> Float:
    triangle, target = factor(rows.regressor, rows.joint_torque, weight * rows.used)
    n_links = robot.n_joints
    positive: list[int] = []
    place = 10 * n_links
    for column in columns:
        count = len(column.joints(transmission))
        positive += range(place, place + count) if column.positive else ()
        place += count
    return consistent_fit(triangle, target, prior, n_links, positive)
