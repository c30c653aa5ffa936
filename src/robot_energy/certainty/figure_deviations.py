"""Standard deviations of the figures of a model, each for itself or known together.

For losses and friction with a covariance C in the model, with ``C = L L'`` the columns of their
deviations are ``g' L``, see `robot_energy.certainty.deviation`.
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
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.friction import FrictionModel
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import Float

TOGETHER_TERMS = (*LOSS_TERMS, "viscous")
"""Powers per joint that differ: Coulomb friction goes with speed as the linear loss does."""
FORM_AT_REST = 0.1
"""What the form of the losses that flow all the time leaves out (fans), over these losses. [-]"""
PROBES = 200  # random motions that weigh the payload against the bodies
BODY_TAGS = ("masses", "centres_of_mass", "inertias")
TORQUE_TAG = "torque"
"""Of the torque of bodies and payload together, which `identify dynamics` finds where single masses
remain derived."""

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
        with_payload: Whether the bodies were found with the payload on the robot: what is wrong
            with it is then taken back by the bodies, as long as the robot carries it.
        drive_share: Of the losses of the drives, whose figures have none of their own, over these;
            of drives without losses over the shaft power. [-]
        loss_dc: Of the constant loss on the DC side. [W]
        loss_grid: Of that on the grid side. [W]
        at_rest: What the form of the losses that flow all the time leaves out. [W]
        returned: Share of the energy fed back that the grid gets. [-]
        fan: Of the cabinet; None without one.
        friction: The friction itself.
        exponent_std: Of the viscous exponents, shape (n,); None without any. [-]
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
        tags = model.urdf.tags
        self.with_payload = TORQUE_TAG in tags
        bodies: list[Tag] = [tags.get(name, "assumed") for name in BODY_TAGS]
        self.bodies = relative_std("bodies", tags.get(TORQUE_TAG, least_known(bodies)))
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
        self.fan = cabinet.fan
        self.at_rest = FORM_AT_REST * model.constant_power()
        efficiency = cabinet.regeneration_efficiency
        self.returned = 0.0 if efficiency is None else efficiency.value
        self.friction = FrictionModel.from_model(model)
        self._exponent_velocity, self.exponent_std = _exponents(model)

    def grid_side(self, fan_powers: Float | None) -> Float | float:
        """Return the deviation of the loss on the grid side, shape () or (N,). [W]

        A fan runs with the probability q where no recording says how it begins. About ``p P_fan``
        its mean square is ``q (1 - p)^2 P_fan^2 + (1 - q) p^2 P_fan^2``. Its power errs, too.

        Args:
            fan_powers: ``p P_fan``, which is expected, and ``q P_fan``, shape (2, N). [W]
        """
        fan = self.fan
        if fan is None or fan_powers is None:
            return self.loss_grid
        fan_power, at_any_begin = fan_powers
        power = fan.power.value
        share = fan_power / power
        switched = fan_power * (power - fan_power)
        switched += (at_any_begin - fan_power) * (power - 2.0 * fan_power)
        known = (share * figure_std(fan.power, "loss_grid")) ** 2
        return np.sqrt(self.loss_grid**2 + switched + known)

    def by_exponent(self, motor_velocity: Float, std: Float) -> tuple[Float, Float]:
        """Return what viscous exponents do to deviations.

        Args:
            motor_velocity: w, 0 where the axis stands, shape (N, n). [rad/s]
            std: Their deviations `exponent_std`, shape (n,). [-]

        Returns:
            What friction grows by over w, ``|w / wq|^(q - 1)`` [-]; what the error of the exponent
            adds to the power of a viscous coefficient of 1 [rad^2/s^2]; shape (N, n) each.
        """
        speed = np.abs(motor_velocity)
        moving = np.where(speed > 0.0, speed, 1.0)
        lever = np.abs(self.friction.viscous_velocity(motor_velocity)) / moving
        turning = np.where(speed > 0.0, speed / self._exponent_velocity, 1.0)
        return lever, std * lever * speed**2 * np.log(turning)


def known_together(factor: Float, speed: Float, motor_torque: Float, viscous: Float) -> Float:
    """Return the columns of what the covariance holds, shape (N, 1 + 4 n).

    Args:
        factor: L, see `FigureDeviations.together`, shape (1 + 4 n, 1 + 4 n). [-]
        speed: Without sign, 0 where the axis stands, shape (N, n). [rad/s]
        motor_torque: That heats the windings, shape (N, n). [N m]
        viscous: Deviation of the viscous friction of each joint for itself, times the square
            of the speed, shape (N, n). [W]
    """
    of_dc = np.ones((len(speed), 1))
    return np.hstack([of_dc, motor_torque**2, speed, speed**2, viscous]) @ factor


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
