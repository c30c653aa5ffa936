"""How well a model explains the torque of a recording, given what is not known of the model.

For every joint, motor side, in the samples in which it moves:

``measured - rigid - rotor = columns . errors + noise``

The errors are those of the model's figures. Each has a normal prior of mean 0: masses, centres and
inertias of all links, small errors of the zeros, gears and torque constants, rotors, the slope of
the velocity, friction and an offset of any size. So a cause of misfit competes with all that the
figures leave open at the poses of the recording, and not with noise alone. What is minimised is
minus twice the logarithm of the marginal likelihood:

``sum_j n_j log(noise_j^2 / variance_j) + |errors / std|^2 + log det(I + std D' D std / noise^2)``

The noise is what no error explains. It repeats with the motion, so a recording counts as
``n_j`` independent samples, and a long one no more than `MAX_INDEPENDENT`. Friction never has the
wrong sign.
"""

from __future__ import annotations

from functools import cached_property
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.certainty.priors import TAGS
from robot_energy.foundation.described import Described
from robot_energy.model.figure import Figure
from robot_energy.timeline.blocks import EffortMeaning, Float, Int
from robot_energy_identify.check.evidence import Evidence

MIN_SAMPLES = 20  # moving samples of a joint, below which nothing is said of its torque
MIN_MOTION = 6.0  # s of it: 24 independent samples of what a model leaves unexplained
CORRELATION_TIME = 0.25  # of what the figures leave unexplained [s]
MAX_INDEPENDENT = 100  # samples of a joint
FLOOR = 1e-3  # share of a joint's torque variance that no model explains

BODIES = {"assumed": (0.16, 0.025), "derived": (0.05, 0.005), "identified": (0.04, 0.006)}  # by tag
PUBLISHED = (0.08, 0.012)  # std of a mass [-] and of a centre along each axis [m], by other tags
CENTRE = 0.03  # std of a centre over its distance from the axis; the greater counts [-]
INERTIA = 0.3  # std of an inertia [-]
ZERO = 0.003  # std of a zero [rad]
GAIN = 0.03  # std of a torque constant, of one joint and of all together [-]
SLOPE = 0.1  # std of the acceleration, which a window smooths [-]
ROTOR = 0.6  # std of a rotor's inertia that is assumed [-]
LOADED = 0.08  # std of friction over the torque of the bodies [-]
STRIBECK = 0.05  # speed at which stiction has fallen to 1/e, over the highest of the joint [-]
LARGEST_PAYLOAD = 0.15  # beyond the known one, of the moving mass [-]
PAYLOAD_CENTRE = 0.15  # std of its centre from the last joint [m]
STEP = 1e-4  # rad: for the change of the torque with a position
OWN = ("gain", "slope", "rotor", "loaded", "coulomb", "viscous", "stribeck", "offset")
NOT_NEGATIVE = ("loaded", "coulomb", "viscous")


class Bodies(Described):
    """Torque of the bodies at the samples, and how it changes; joint side, n joints."""

    torque: Annotated[Float, "Shape (N, n). [N m] or [N]"]
    inertial: Annotated[Float, "The part of it that accelerates, shape (N, n). [N m] or [N]"]
    by_parameter: Annotated[Float, "Per unit of each inertial parameter, shape (N, n, 10 n)."]
    by_position: Annotated[Float, "Per change of each position, shape (N, n, n). [N m/rad]"]

    @classmethod
    def of(cls, evidence: Evidence) -> Bodies:
        robot, (position, velocity, acceleration) = evidence.robot, evidence.motion
        torque = robot.joint_torque(position, velocity, acceleration)
        still = robot.joint_torque(position, velocity, np.zeros_like(acceleration))
        by_position = np.zeros((*torque.shape, torque.shape[1]))
        for j in np.flatnonzero(~np.asarray(robot.limits.prismatic)).tolist():
            step = np.zeros(torque.shape[1])
            step[j] = STEP
            ahead = robot.joint_torque(position + step, velocity, acceleration)
            by_position[:, :, j] = (ahead - torque) / STEP
        return cls(
            torque,
            torque - still,
            robot.torque_regressor(position, velocity, acceleration),
            by_position,
        )


class Errors(Described):
    """Most likely errors under given priors."""

    cost: Annotated[float, "Minus twice the logarithm of the marginal likelihood, less a constant."]
    values: Annotated[Float, "Of each column, in its unit."]
    std: Annotated[Float, "Their standard deviations."]
    unexplained: Annotated[Float, "Of each joint's variance, shape (n,); NaN where unknown. [-]"]
    surprise: Annotated[
        float, "Squared errors of bodies, zeros, gains over priors, per one determined. [-]"
    ]
    freedom: Annotated[float, "Part of the cost that is the logarithm of the determinant."]


class TorqueFit:
    """The columns of one recording, summed up as products; its bodies may be known."""

    def __init__(self, evidence: Evidence, bodies: Bodies | None = None) -> None:
        self.evidence, n = evidence, len(evidence.names)
        self.bodies = bodies or Bodies.of(evidence)
        self.groups: dict[str, slice] = {}
        at = 0
        for name, count in (
            *((f"link {k}", 10) for k in range(n)), ("zeros", n), ("payload", 10), ("gain", 1),
            *((f"joint {j}", len(OWN)) for j in range(n)),
        ):  # fmt: skip
            self.groups[name] = slice(at, at + count)
            at += count
        self.prior = np.zeros(at)
        self._not_negative = np.zeros(at, dtype=np.bool_)
        self._products: dict[int, Float] = {}
        self._columns: dict[int, tuple[NDArray[np.bool_], Float]] = {}  # rows, without target
        self.variance, self._independent = np.full((2, n), np.nan)  # of each torque [(N m)^2]
        self._fill(n)

    def _fill(self, n: int) -> None:
        """Sum up the products of the columns of every joint that is known well enough."""
        evidence, bodies, groups = self.evidence, self.bodies, self.groups
        train, robot = evidence.drivetrain, evidence.robot
        to_motor = train.motor_torque_from_joint(np.eye(n))
        rigid, rotor, known = _known(evidence, bodies.torque)
        inertial = train.motor_torque_from_joint(bodies.inertial)
        sensed = evidence.effort is EffortMeaning.JOINT_TORQUE
        speed = train.motor_velocity_from_joint(evidence.velocity)
        # In memory joint by joint, as it is read.
        shared = np.zeros((n, len(rigid), groups["gain"].stop)).transpose(1, 0, 2)
        parameters = robot.link_parameters.reshape(n, 10)
        by_parameter = np.einsum("nji,jk->nki", bodies.by_parameter, to_motor)
        for k, own in enumerate(parameters):
            part = by_parameter[:, :, 10 * k : 10 * k + 10]
            at = groups[f"link {k}"].start
            shared[:, :, at] = part @ own
            shared[:, :, at + 1 : at + 10] = part[:, :, 1:]
            self.prior[at : at + 10] = self._body_priors(own)
        shared[:, :, groups["zeros"]] = -np.einsum("nji,jk->nki", bodies.by_position, to_motor)
        self.prior[groups["zeros"]] = np.where(robot.limits.prismatic, 0.0, ZERO)
        shared[:, :, groups["payload"]] = by_parameter[:, :, 10 * (n - 1) :]
        shared[:, :, groups["gain"].start] = rigid
        self.prior[groups["gain"]] = GAIN
        usable = evidence.moving & np.isfinite(evidence.motor_torque) & np.isfinite(known)
        motion = evidence.durations @ usable
        for j in range(n):
            rows = usable[:, j]
            if motion[j] < MIN_MOTION or int(rows.sum()) < MIN_SAMPLES:
                continue
            target, turn = evidence.motor_torque[rows, j], speed[rows, j]
            variance = float(np.var(target))
            if not variance > 0.0:
                continue
            sign, size, loaded = np.sign(turn), float(np.sqrt(np.mean(target**2))), rigid[rows, j]
            fast = float(np.max(np.abs(turn)))
            gear, inertia = (
                evidence.model.joints[j].gear_ratio, evidence.model.joints[j].rotor_inertia,
            )  # fmt: skip
            wide = _relative(gear, 0.0)
            own = {
                "gain": (loaded, np.hypot(GAIN, 0.0 if sensed else wide)),
                "slope": (inertial[rows, j], SLOPE),
                "rotor": (
                    rotor[rows, j],
                    np.hypot(0.5 if sensed else SLOPE,
                             np.hypot(_relative(inertia, ROTOR), 2.0 * wide if sensed else 0.0)),
                ),
                "loaded": (np.abs(loaded) * sign, LOADED),
                "coulomb": (sign, size),
                "viscous": (turn / fast, size),
                "stribeck": (sign * np.exp(-np.abs(turn) / (STRIBECK * fast)), 0.2 * size),
                "offset": (np.ones(len(turn)), size),
            }  # fmt: skip
            place = groups[f"joint {j}"]
            self.prior[place] = [own[name][1] for name in OWN]
            self._not_negative[place] = [name in NOT_NEGATIVE for name in OWN]
            columns = np.stack([*(own[name][0] for name in OWN), target - known[rows, j]], axis=1)
            block = np.concatenate([shared[rows, j], columns], axis=1)
            self._products[j], self._columns[j] = block.T @ block / len(turn), (rows, block[:, :-1])
            self.variance[j] = variance
            self._independent[j] = min(motion[j] / CORRELATION_TIME, MAX_INDEPENDENT)

    def _body_priors(self, own: Float) -> Float:
        """Standard deviations of the mass [-], the moments [kg m] and the inertias of a link."""
        share, apart = BODIES.get(self.evidence.model.urdf.tags.get("masses", ""), PUBLISHED)
        mass = max(float(own[0]), 0.1)
        apart = max(apart, CENTRE * float(np.linalg.norm(own[1:4])) / mass)
        most = float(np.max(own[[4, 6, 9]])) + mass * apart**2
        return np.concatenate([[share], np.full(3, mass * apart), np.full(6, INERTIA * most)])

    @property
    def known(self) -> NDArray[np.bool_]:
        """Which joints are judged, shape (n,)."""
        return np.isfinite(self.variance)

    def rough_cost(self, evidence: Evidence) -> float:
        """Return about the cost of evidence with the same torque in other motion, rather too high.

        With the columns of this one it is a hundredth of the work of a fit, and shows what is not
        worth one.
        """
        torque = evidence.robot.joint_torque(*evidence.motion)
        rest = evidence.motor_torque - _known(evidence, torque)[2]
        matrix, right = np.eye(len(self.prior)), np.zeros(len(self.prior))
        parts: list[tuple[float, Float, Float, Int, float]] = []
        for j, (rows, columns) in self._columns.items():
            own = evidence.motor_torque[rows, j]
            variance, target = float(np.var(own)), rest[rows, j]
            if not np.isfinite(target).all() or not variance > 0.0:
                return -np.inf
            at = self._places(j)
            scaled = columns * self.prior[at]
            noise = float(self.errors.unexplained[j]) * variance
            weight = float(self._independent[j]) / noise / len(target)
            self._add(matrix, j, weight * (scaled.T @ scaled))
            right[at] += weight * (scaled.T @ target)
            parts.append((float(self._independent[j]), scaled, target, at, variance))
        values = np.linalg.solve(matrix, right)
        cost = float(values @ values) + self.errors.freedom
        for independent, scaled, target, at, variance in parts:
            left = float(np.mean((target - scaled @ values[at]) ** 2))
            cost += independent * float(np.log(left / variance + FLOOR))
        return cost

    def _places(self, joint: int) -> Int:
        """Columns that act on a joint."""
        return np.r_[0 : self.groups["gain"].stop, self.groups[f"joint {joint}"]]

    def _add(self, matrix: Float, joint: int, product: Float) -> None:
        """Add the product of the columns that act on a joint to that of all."""
        shared = self.groups["gain"].stop
        parts = (
            (slice(shared), slice(shared)),
            (self.groups[f"joint {joint}"], slice(shared, None)),
        )
        for row, of_row in parts:
            for column, of_column in parts:
                matrix[row, column] += product[of_row, of_column]

    @cached_property
    def errors(self) -> Errors:
        """The most likely errors under the priors of the model."""
        return self.with_prior(self.prior)

    @property
    def cost(self) -> float:
        return self.errors.cost

    def freed(self, group: str, std: Float | float, place: int | None = None) -> Errors:
        """Return the errors where those of a group may be larger.

        Args:
            std: Instead of its prior, one per column or of all. [unit of each column]
        """
        prior, own = self.prior.copy(), self.groups[group]
        prior[own if place is None else own.start + place] = std
        return self.with_prior(prior)

    def widened(self, factor: float, links: tuple[int, ...]) -> Errors:
        """Return the errors where the bodies of links may be further off.

        Args:
            factor: On their priors. [-]
        """
        prior = self.prior.copy()
        for link in links:
            prior[self.groups[f"link {link}"]] *= factor
        return self.with_prior(prior)

    def with_prior(self, prior: Float) -> Errors:
        """Return the most likely errors.

        Args:
            prior: Standard deviation of each column, 0 for one that is not there. [its unit]
        """
        n, width = len(self.evidence.names), len(prior)
        scaled, places = dict[int, Float](), dict[int, Int]()
        for j, product in self._products.items():
            places[j] = self._places(j)
            std = np.append(prior[places[j]], 1.0)
            scaled[j] = product * np.multiply.outer(std, std)
        noise = {j: 0.1 * float(self.variance[j]) for j in scaled}
        matrix, values = np.eye(width), np.zeros(width)
        for _ in range(3):
            matrix, right = np.eye(width), np.zeros(width)
            for j, product in scaled.items():
                weight, at = self._independent[j] / noise[j], places[j]
                self._add(matrix, j, weight * product[:-1, :-1])
                right[at] += weight * product[:-1, -1]
            values = self._bounded(matrix, right)
            for j, product in scaled.items():
                with_target = np.append(-values[places[j]], 1.0)
                left = float(with_target @ product @ with_target)
                noise[j] = max(left, 0.0) + FLOOR * float(self.variance[j])
        unexplained = np.full(n, np.nan)
        for j, left in noise.items():
            unexplained[j] = left / self.variance[j]
        covariance = np.linalg.inv(matrix)
        determined = 1.0 - np.diagonal(covariance)
        judged = slice(0, self.groups["gain"].stop)
        freedom = float(np.linalg.slogdet(matrix)[1])
        cost = float(np.nansum(self._independent * np.log(unexplained)))
        cost += float(values @ values) + freedom
        return Errors(
            cost,
            prior * values,
            prior * np.sqrt(np.diagonal(covariance)),
            unexplained,
            float(np.square(values[judged]).sum() / max(determined[judged].sum(), 1.0)),
            freedom,
        )

    def _bounded(self, matrix: Float, right: Float) -> Float:
        """Solve, with no friction of the wrong sign."""
        free = np.ones(len(right), dtype=np.bool_)
        values = np.zeros(len(right))
        for _ in range(4):
            values = np.zeros(len(right))
            values[free] = np.linalg.solve(matrix[np.ix_(free, free)], right[free])
            wrong = free & self._not_negative & (values < 0.0)
            if not wrong.any():
                return values
            free &= ~wrong
        return np.where(self._not_negative, np.maximum(values, 0.0), values)


def same_motion(one: Evidence, other: Evidence) -> bool:
    """Whether the bodies of two have the same torque, without a look at the figures."""
    names = ("position", "velocity", "acceleration", "robot")
    return all(getattr(one, name) is getattr(other, name) for name in names)


def _known(evidence: Evidence, torque: Float) -> tuple[Float, Float, Float]:
    """Torque of bodies, of rotors, and both as far as the effort holds them, motor side. [N m]"""
    train = evidence.drivetrain
    rigid, rotor = train.motor_torque_from_joint(torque), train.rotor_torque(evidence.acceleration)
    # computed from the current, a joint torque holds what turns the rotors; a sensor sees none
    share = 0.5 if evidence.effort is EffortMeaning.JOINT_TORQUE else 1.0
    return rigid, rotor, rigid + share * rotor


def _relative(figure: Figure, assumed: float) -> float:
    """Standard deviation of a figure over its value; where it states none, by its tag. [-]"""
    if figure.std is None or not figure.value:
        return assumed * TAGS[figure.tag]
    return figure.std / abs(figure.value)
