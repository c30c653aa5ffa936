"""Standard deviation of power from those of the model's figures, sample by sample.

To first order the error of the predicted power is ``sum_k g_k e_k``: ``g_k`` is the change of the
power with figure k, ``e_k`` the error of that figure. A column of `PowerDeviation` is
``g_k s_k`` in watts, with the standard deviation ``s_k``. Errors of figures are constant or
change slowly, so the columns are integrated before they are squared: the standard deviation of
an energy is ``sqrt(sum_k (integral g_k s_k dt)^2)``, which grows with time. Different figures
are taken as independent, but for losses and friction with a covariance C in the model: with
``C = L L'`` their columns are ``g' L``, which are independent and have a sign.

Motor side, per joint: ``|w| s(fc)`` and ``w^2 s(fv)`` are one column, as are all losses of the
drive; that adds them a little too much (Minkowski), never too little. Of ``s(fv)``, what errs
alike at all joints (an unknown temperature) is a column of the robot. What the brake resistor takes
never reaches the grid: there the columns are 0.

What the form of the model leaves out of friction and drive losses is a share of them; a meter
shows it, so it counts only without one. What it leaves out of the losses that flow all the time is
in their column on the grid side. What no figure explains (delays, elasticity) is taken as
a share of the shaft power with a short correlation time; its variance grows with time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from robot_energy.certainty.priors import MISSING_LOSS, figure_std, relative_std
from robot_energy.model import RobotModel
from robot_energy.model.drive_models import DRIVE_MODELS, LossDrive
from robot_energy.model.figure import Tag, least_known, tag_of
from robot_energy.model.schema import FRICTION_TERMS, LOSS_TERMS
from robot_energy.physics.derivative import windows_of
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.equations import Balance
from robot_energy.physics.friction import FrictionModel
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import Float, Int, differences

CABINET_DEVIATIONS = (
    "bodies", "payload", "loss_dc", "together", "loss_grid", "temperature", "form", "random",
    "bus",
)  # fmt: skip
"""Columns of the robot; ``random`` is in W^2 s, ``bus`` the root sum of squares of all but
``loss_grid``, ``temperature`` and ``form``; ``together`` begins what has a covariance."""
TOGETHER_TERMS = (*LOSS_TERMS, "viscous")
"""Powers per joint that differ: Coulomb friction goes with speed as the linear loss does."""
JOINT_DEVIATIONS = ("friction", "drive", *(f"together_{term}" for term in TOGETHER_TERMS))
TOGETHER_NAME = "losses and friction known together"
FORM = 0.06
"""What the form of friction and drive losses leaves out, over their power. [-]

Real losses follow other laws of speed, load and temperature than those of the model."""
FORM_AT_REST = 0.1
"""What the form of the losses that flow all the time leaves out (fans), over these losses. [-]"""
UNEXPLAINED = 0.06
"""Standard deviation of the power that no figure explains, over the sum of |shaft power|. [-]"""
UNEXPLAINED_TIME = 0.02
"""Its correlation time: the integral of its autocorrelation from 0 on. [s]

Short: most of it is a matter of a few tenths of a second (delays, elastic gears), where what is
missing now comes a moment later."""
SLOT_NS, RECENT_SLOTS = 20_000_000, 25
"""It follows the shaft power of the last half second, sampled every 20 ms."""
MAX_DEVIATION = 1e6  # no interval becomes too large for a register [W]
PROBES = 200  # random motions that weigh the payload against the bodies
BODY_TAGS = ("masses", "centres_of_mass", "inertias")

DriveDeviation = Callable[[Float, Float, Float], Float]
"""Speed without sign, torque and drive loss, shape (N, n) each -> deviation of the loss. [W]"""

LossDeviations = Callable[[Float, Float], Float]
"""Speed without sign and torque, shape (N, n) each -> deviation of the loss by the error of each of
C figures, shape (C, N, n). [W]"""


class FigureDeviations:
    """Deviations of the figures of a model that powers and energies have in common.

    Attributes:
        model: Without the deviations of what its covariance holds.
        together: Factor L of that covariance, of ``loss_dc`` and `TOGETHER_TERMS` of the joints
            by independent errors, shape (1 + 4 n, 1 + 4 n); None without a covariance.
        of_grid: That of ``loss_grid``, shape (1 + 4 n,). [W]
        viscous: Whether the viscous friction of a joint errs for itself: 1, else 0, shape (n,).
        coulomb: Of the Coulomb torques, motor side, shape (n,). [N m]
        bodies: Of the rigid-body power, as a share of it. [-]
        payload: Of the part of it that the payload takes, as a share of that. [-]
        payload_share: That part, see `payload_shares`, shape (n,). [-]
        drive_share: Of the losses of the drives, whose figures have none of their own, over these;
            of drives without losses over the shaft power. [-]
        loss_dc: Of the constant loss on the DC side. [W]
        loss_grid: Of that on the grid side. [W]
        at_rest: What the form of the losses that flow all the time leaves out. [W]
        returned: Share of the energy fed back that the grid gets. [-]
        friction: The friction itself.
    """

    def __init__(self, model: RobotModel) -> None:
        together = set(() if model.covariance is None else model.covariance.figures)
        model, factor = known_apart(model)
        self.model = model
        self.together = None if factor is None else factor[:-1]
        self.of_grid = np.zeros(1) if factor is None else factor[-1]
        self.viscous = np.array(
            [
                0.0 if factor is not None and f"viscous of {name}" in together else 1.0
                for name in model.joint_names
            ]
        )
        self.coulomb = np.asarray(
            [figure_std(joint.friction.coulomb, "coulomb") for joint in model.joints]
        )
        bodies: list[Tag] = list(model.urdf.tags.get(name, "assumed") for name in BODY_TAGS)
        self.bodies = relative_std("bodies", least_known(bodies))
        carried: list[Tag] = [body.tag for body in model.payload]
        self.payload = relative_std("payload", least_known(carried))
        self.payload_share = payload_shares(model)
        kind, self.drive_share = DRIVE_MODELS[model.drive], MISSING_LOSS
        if not kind.lossless:
            entries = kind.entries(model.joints)
            tag = least_known([tag_of(entry) for entry in entries])
            self.drive_share = relative_std("drive", tag)
        cabinet = model.cabinet
        self.loss_dc = figure_std(cabinet.loss_dc, "loss_dc")
        self.loss_grid = figure_std(cabinet.loss_grid, "loss_grid")
        self._fan = cabinet.fan
        self.at_rest = FORM_AT_REST * model.constant_power()
        efficiency = cabinet.regeneration_efficiency
        self.returned = 0.0 if efficiency is None else efficiency.value
        self.friction = FrictionModel.from_model(model)
        self._exponent_velocity, self._exponent_std = _exponents(model)

    def grid_side(self, fan_power: Float | float) -> Float | float:
        """Return the deviation of the loss on the grid side, shape () or (N,). [W]

        A fan that runs with the probability p errs by ``P_fan sqrt(p (1 - p))``, and its power.

        Args:
            fan_power: That is to be expected, ``p P_fan``, shape (N,). [W]
        """
        fan = self._fan
        if fan is None or fan.power.value == 0.0:
            return self.loss_grid
        share = fan_power / fan.power.value
        switched = fan_power * (fan.power.value - fan_power)
        known = (share * figure_std(fan.power, "loss_grid")) ** 2
        return np.sqrt(self.loss_grid**2 + switched + known)

    def by_exponent(self, motor_velocity: Float) -> tuple[Float, Float] | None:
        """Return what viscous exponents do to deviations; None without any.

        Args:
            motor_velocity: w, 0 where the axis stands, shape (N, n). [rad/s]

        Returns:
            What friction grows by over w, ``|w / wq|^(q - 1)`` [-]; what the error of the exponent
            adds to the power of a viscous coefficient of 1 [rad^2/s^2]; shape (N, n) each.
        """
        if self._exponent_std is None:
            return None
        speed = np.abs(motor_velocity)
        moving = np.where(speed > 0.0, speed, 1.0)
        lever = np.abs(self.friction.viscous_velocity(motor_velocity)) / moving
        turning = np.where(speed > 0.0, speed / self._exponent_velocity, 1.0)
        return lever, self._exponent_std * lever * speed**2 * np.log(turning)

    def known_together(self, speed: Float, motor_torque: Float, viscous: Float) -> Float | None:
        """Return the columns of what the covariance holds, shape (N, 1 + 4 n); None without one.

        Args:
            speed: Without sign, 0 where the axis stands, shape (N, n). [rad/s]
            motor_torque: That heats the windings, shape (N, n). [N m]
            viscous: Deviation of the viscous friction of each joint for itself, times the square
                of the speed, shape (N, n). [W]
        """
        if self.together is None:
            return None
        of_dc = np.ones((len(speed), 1))
        return np.hstack([of_dc, motor_torque**2, speed, speed**2, viscous]) @ self.together


class PowerDeviation:
    """Columns ``g_k s_k`` of one robot."""

    def __init__(self, model: RobotModel) -> None:
        first, own = len(CABINET_DEVIATIONS), 2 * len(model.joints)
        last = first + len(JOINT_DEVIATIONS) * len(model.joints)
        self._places = [CABINET_DEVIATIONS.index("together"), *range(first + own, last)]
        figures = self._figures = FigureDeviations(model)
        model = figures.model
        self._coulomb_squared = figures.coulomb**2
        by_load = [joint.friction.load_coulomb for joint in model.joints]
        self._by_load = np.asarray(
            [0.0 if one is None else figure_std(one, "coulomb") for one in by_load]
        )
        self._viscous_prior = np.asarray(
            [relative_std("viscous", tag_of(joint.friction.viscous)) for joint in model.joints]
        )
        kind = DRIVE_MODELS[model.drive]
        self._drive: DriveDeviation | None = None
        self._drive_share = figures.drive_share
        if kind.deviation is not None:
            self._drive = kind.deviation(kind.entries(model.joints))
        elif not kind.lossless:
            self._drive = partial(_share_of_loss, share=figures.drive_share)
        self._loss_dc = figures.loss_dc
        self._returned = figures.returned
        self._bodies, self._payload = figures.bodies, figures.payload
        self._payload_share = figures.payload_share
        self._payload_mass = sum(body.mass for body in model.payload)
        self._slot = -1
        self._recent: Float = np.zeros(RECENT_SLOTS)

    def _recent_peak(self, stamp_ns: Int, power: Float) -> Float:
        """Greatest of the newest slots, each by its first sample, and of the sample itself."""
        slot = stamp_ns // SLOT_NS
        begins = differences(slot, self._slot) != 0
        self._slot = int(slot[-1])
        if not begins.any():
            return np.maximum(self._recent.max(), power)
        fresh = power[begins]
        if not np.isfinite(fresh.sum()):
            fresh = np.nan_to_num(fresh)
        values = np.concatenate([self._recent, fresh])
        self._recent = values[-RECENT_SLOTS:]
        peaks = windows_of(values, RECENT_SLOTS).max(axis=1)
        return np.maximum(peaks[np.cumsum(begins)], power)

    def columns(
        self,
        motor_velocity: Float,
        motor_torque: Float,
        rigid_power: Float,
        friction_power: Float,
        drive_loss: Float,
        viscous: Float,
        viscous_std: Float,
        shared_std: Float,
        held: Float,
        fan_power: Float | float,
        payload_mass: Float,
        balance: Balance,
        stamp_ns: Int,
    ) -> Float:
        """Return the deviations of the power that a meter at the grid sees, shape (N, K).

        Args:
            motor_velocity: 0 where the axis stands, shape (N, n). [rad/s]
            motor_torque: That heats the windings, shape (N, n). [N m]
            rigid_power: Shape (N, n). [W]
            friction_power: Shape (N, n). [W]
            drive_loss: Shape (N, n). [W]
            viscous: Coefficient in use, shape (N, n). [N m s/rad]
            viscous_std: Its deviation, NaN for that of the prior, shape (N, n). [N m s/rad]
            shared_std: The part of it that errs alike at all joints, shape (N, n). [N m s/rad]
            held: Deviation of the loss at rest by what motors hold there, shape (N, n). [W]
            fan_power: That is to be expected, shape (N,). [W]
            payload_mass: In force, shape (N,). [kg]
            stamp_ns: Shape (N,). [ns]
        """
        size, n_joints = rigid_power.shape
        first = len(CABINET_DEVIATIONS)
        columns = np.empty((size, first + len(JOINT_DEVIATIONS) * n_joints), order="F")
        bodies, payload, loss_dc, _, loss_grid, temperature, form, random, bus = columns[
            :, :first
        ].T
        friction, drive = np.hsplit(columns[:, first : first + 2 * n_joints], 2)
        speed, shaft = np.abs(motor_velocity), np.abs(rigid_power + friction_power)
        squared = speed**2
        std, shared = viscous_std, shared_std
        if np.isnan(std.sum()):
            std = np.where(np.isnan(std), self._viscous_prior * viscous, std)
            shared = np.nan_to_num(shared)
        bent = self._figures.by_exponent(motor_velocity)
        if bent is not None:
            std, shared = std * bent[0], shared * bent[0]
        variance = std**2
        if shared.any():
            variance -= shared**2
        variance *= squared
        np.maximum(variance, 0.0, out=variance)
        together = self._figures.known_together(speed, motor_torque, np.sqrt(variance) * speed)
        if together is not None:
            variance *= self._figures.viscous
        variance += self._coulomb_squared
        np.sqrt(variance, out=friction)
        friction *= speed
        if self._by_load.any():  # of friction by load: its share times the torque of the bodies
            np.hypot(friction, self._by_load * rigid_power, out=friction)
        if bent is not None:
            np.hypot(friction, bent[1] * viscous, out=friction)
        if self._drive is None:
            np.multiply(self._drive_share, shaft, out=drive)
        else:
            drive[:] = self._drive(speed, motor_torque, drive_loss)
        if held.any():
            np.hypot(drive, held, out=drive)
        carried = self._payload_share
        if self._payload_mass > 0:
            carried = carried * np.minimum(payload_mass / self._payload_mass, 1.0)[:, None]
        table = np.empty((6, n_joints, size))
        table[0], table[2] = rigid_power.T, shaft.T
        np.multiply(rigid_power, carried, out=table[1].T)
        np.multiply(shared, squared, out=table[3].T)
        np.multiply(friction, friction, out=table[4].T)
        table[4] += (drive**2).T
        np.abs(drive_loss, out=table[5].T)
        table[5] += friction_power.T
        rigid, of_payload, moved, temperature[:], squares, lost = _in_order(table.swapaxes(0, 1))
        np.multiply(FORM, lost, out=form)
        np.multiply(self._payload, of_payload, out=payload)
        np.multiply(self._bodies, rigid - of_payload, out=bodies)
        loss_dc[:] = self._loss_dc
        loss_grid[:] = np.hypot(self._figures.grid_side(fan_power), self._figures.at_rest)
        unexplained = (UNEXPLAINED * self._recent_peak(stamp_ns, moved)) ** 2
        np.multiply(2.0 * UNEXPLAINED_TIME, unexplained, out=random)
        squares = squares + bodies**2 + payload**2 + loss_dc**2
        reaches = np.where(balance.brake_power > 0, 0.0, 1.0)
        if self._returned:
            reaches[balance.grid_power < balance.loss_grid] = self._returned
        if together is not None:
            squares = squares + (together**2).sum(axis=1)
        if (reaches < 1.0).any():
            for column in (bodies, payload, temperature, form, loss_dc, *friction.T, *drive.T):
                column *= reaches
            squares *= reaches**2
        columns[:, self._places] = (
            0.0 if together is None else together * reaches[:, None] + self._figures.of_grid
        )
        np.sqrt(squares + unexplained, out=bus)
        if not max(float(columns.max()), -float(columns.min())) <= MAX_DEVIATION:
            np.fmin(columns, MAX_DEVIATION, out=columns)
            np.fmax(columns, -MAX_DEVIATION, out=columns)
        return columns


def known_apart(model: RobotModel) -> tuple[RobotModel, Float | None]:
    """Return a model whose figures err each for itself, and by how much others err together.

    Returns:
        The model; the figures of its covariance have no deviation left in it but for ``loss_grid``
        and viscous friction, whose deviation is that of its law.
        The factor L of the covariance, of ``loss_dc``, `TOGETHER_TERMS` of the joints and
        ``loss_grid`` by the columns of all but the last, shape (2 + 4 n, 1 + 4 n); None without
        a covariance.
    """
    covariance = model.covariance
    if covariance is None or DRIVE_MODELS[model.drive].loss_deviations is None:
        return model, None
    terms = [f"{term} of {name}" for term in TOGETHER_TERMS for name in model.joint_names]
    order = ["loss_dc", *terms, "loss_grid"]
    adds_to = [name.replace("coulomb of ", "linear of ", 1) for name in covariance.figures]
    known = [name for name in order if name in adds_to]
    sums = np.array([[1.0 if name == other else 0.0 for other in adds_to] for name in known])
    matrix = sums @ np.array(covariance.matrix) @ sums.T
    scale = np.sqrt(np.diagonal(matrix))
    scale = np.where(scale > 0, scale, 1.0)
    matrix = matrix / np.outer(scale, scale)
    size, direction = np.linalg.eigh(matrix)
    root = direction * np.sqrt(np.maximum(size, 0.0))
    lower = np.linalg.qr(root.T).R.T * scale[:, None]  # L with C = L L'
    factor = np.zeros((len(order), len(order)))
    places = [order.index(name) for name in known]
    factor[np.ix_(places, places)] = lower
    sure = set(covariance.figures)
    joints = [
        joint.model_copy(
            update={
                "losses": _without_std(joint.losses, LOSS_TERMS, joint.name, sure),
                "friction": _without_std(joint.friction, FRICTION_TERMS[:1], joint.name, sure),
            }
        )
        for joint in model.joints
    ]
    update = {name: 0.0 for name in ("loss_dc", "loss_grid") if name in sure}
    if "loss_grid" in sure:
        update["loss_grid"] = abs(float(factor[-1, -1]))
    cabinet = model.cabinet.model_copy(
        update={
            name: getattr(model.cabinet, name).model_copy(update={"std": std})
            for name, std in update.items()
        }
    )
    return model.changed(joints=joints, cabinet=cabinet, covariance=None), factor[:, :-1]


def _exponents(model: RobotModel) -> tuple[Float, Float | None]:
    """Velocities at which viscous exponents change nothing, and deviations; None without any."""
    bent = [joint.friction.viscous_exponent for joint in model.joints]
    velocity = np.asarray([one.velocity.value if one else 1.0 for one in bent])
    if not any(bent):
        return velocity, None
    std = [figure_std(one.exponent, "viscous_exponent") if one else 0.0 for one in bent]
    return velocity, np.asarray(std)


def _without_std(entry: Any, terms: Sequence[str], joint: str, sure: set[str]) -> Any:
    if entry is None:
        return None
    return entry.model_copy(
        update={
            term: getattr(entry, term).model_copy(update={"std": 0.0})
            for term in terms
            if f"{term} of {joint}" in sure
        }
    )


def _in_order(table: Float) -> Float:
    """Sum over the first axis in a fixed order, so that the result never depends on the others."""
    total = table[0]
    for row in table[1:]:
        total += row
    return total


def _loss_stds(entries: list[LossDrive]) -> dict[str, Float]:
    return {
        name: np.asarray([figure_std(getattr(entry, name), name) for entry in entries])
        for name in ("constant", "linear", "quadratic", "copper")
    }


def loss_model_deviation(entries: list[LossDrive]) -> DriveDeviation:
    """Return the deviation of ``c0 + c1 |w| + c2 w^2 + copper tau^2``, windings at 20 degC."""
    return partial(_loss_deviation, **_loss_stds(entries))


def _loss_deviation(
    speed: Float,
    torque: Float,
    loss: Float,
    *,
    constant: Float,
    linear: Float,
    quadratic: Float,
    copper: Float,
) -> Float:
    square = speed**2
    return np.sqrt(
        constant**2 + linear**2 * square + (quadratic * square) ** 2 + (copper * torque**2) ** 2
    )


def _share_of_loss(speed: Float, torque: Float, loss: Float, *, share: float) -> Float:
    return share * np.abs(loss)


def loss_model_deviations(entries: list[LossDrive]) -> LossDeviations:
    """Return the four terms of `loss_model_deviation`, each for itself."""
    stds = _loss_stds(entries).values()

    def deviations(speed: Float, torque: Float) -> Float:
        of_one = np.ones_like(speed), speed, speed**2, torque**2
        return np.stack([std * one for std, one in zip(stds, of_one, strict=True)])

    return deviations


def payload_shares(model: RobotModel) -> Float:
    """Return the share of the payload in the rigid motor torque, 0 to 1, shape (n,); 0 without.

    ``c_i = sum(tau_p tau) / sum(tau^2)`` of joint i, with the torque ``tau_p`` that the payload
    adds to ``tau``; half of each of 200 motions is gravity at rest.
    """
    names = model.joint_names
    if not sum(body.mass for body in model.payload):
        return np.zeros(len(names))
    robot, drivetrain = Robot.from_model(model), Drivetrain.from_model(model)
    random = np.random.default_rng(0)
    position = random.uniform(-1.5, 1.5, (PROBES, len(names)))
    velocity, acceleration = random.uniform(-1.0, 1.0, (2, PROBES, len(names)))
    for values in (velocity, acceleration):
        values[: PROBES // 2] = 0.0
    whole, alone = (
        drivetrain.motor_torque_from_joint(one.joint_torque(position, velocity, acceleration))
        + drivetrain.rotor_torque(acceleration)
        for one in (robot, robot.with_payload(()))
    )
    squares = (whole**2).sum(axis=0)
    shares = ((whole - alone) * whole).sum(axis=0) / np.where(squares > 0, squares, 1.0)
    return np.clip(shares, 0.0, 1.0)


def names_of(joint_names: Sequence[str]) -> tuple[str, ...]:
    """Return words for every column but ``bus``, in their order."""
    return (
        "bodies",
        "payload",
        "constant loss, DC side",
        TOGETHER_NAME,
        "constant loss, grid side",
        "temperature of the friction",
        "form of friction and drive losses",
        "what the model leaves out",
        *(f"friction of {name}" for name in joint_names),
        *(f"drive of {name}" for name in joint_names),
        *(TOGETHER_NAME for _ in TOGETHER_TERMS for _ in joint_names),
    )
