"""Motions that identify a robot's parameters: optimised finite Fourier series (paper B, 4.3.2).

The criterion is one of the observation matrix of the base parameters, links and everything else
that `identify dynamics` fits. Rows are divided by the joint's RMS torque and columns by their
RMS, both over states drawn evenly within the limits. These scales belong to the robot and
not to a motion, so figures of different motions compare, and a small motion is worse than
a large one. (Columns scaled to unit length by the motion itself would hide its size.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field
from typing import Annotated, Any, Literal

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import MotionError
from robot_energy.model import RobotModel
from robot_energy.results.base import Number, Result, Texts, known
from robot_energy.timeline.blocks import Float
from robot_energy_identify.blas_threads import one_thread
from robot_energy_identify.dynamics.base_parameters import not_excited
from robot_energy_identify.dynamics.torque_model import (
    ParameterColumn,
    TorqueModel,
    standard_columns,
)
from robot_energy_identify.excitation.limits import ExcitationLimits, Floor, slopes
from robot_energy_plan.motion import FourierBasis, FourierMotion, Trajectory

Criterion = Literal["condition", "determinant"]
STATES = 400  # drawn for the scales
SAMPLES_PER_HARMONIC = 20  # of one period, in the optimisation
CHECKED_RATE = 1000.0  # Hz at which limits are checked in the end
FIRST_USE = 0.5  # of the limits, by a start
MAX_TRIES = 200
SHRINK = 0.98
MAX_SHRINKS = 30
MAX_HALVES = 8
PLATEAU = 1e-4  # change of the criterion's logarithm at which a start is done


class ExcitationScore(Described):
    """How well a motion determines the base parameters."""

    condition: Annotated[float, "Condition number of the scaled observation matrix."]
    log_determinant: Annotated[
        float, "Of the scaled information matrix per row, over the number of base parameters."
    ]
    not_excited: Annotated[tuple[str, ...], "Base parameters that the motion does not determine."]


class ExcitationCriterion:
    """Scaled observation matrix of the base parameters of one robot."""

    def __init__(
        self, model: RobotModel, limits: ExcitationLimits, columns: tuple[ParameterColumn, ...]
    ) -> None:
        self.limits = limits
        self._torque_model = TorqueModel.from_model(model, columns)
        self.base = self._torque_model.structure()
        random = np.random.default_rng(0)
        shape = (STATES, limits.robot.n_joints)
        draw = [random.uniform(-1.0, 1.0, shape) for _ in range(3)]
        states = Trajectory(
            limits.middle + limits.reach * draw[0],
            limits.velocity * draw[1],
            limits.acceleration * draw[2],
        )
        torque = np.sqrt((limits.joint_torque(states) ** 2).mean(axis=0))
        rows = self._torque_model.regressor(states)[:, :, self.base.independent] / torque[:, None]
        size = np.sqrt((rows**2).mean(axis=(0, 1)))
        self._scale = 1.0 / (torque[:, None] * size)

    def rows(self, motion: Trajectory) -> Float:
        """Return the scaled observation matrix over the root of its number of rows, (N, n, B)."""
        rows = self._torque_model.regressor(motion)[:, :, self.base.independent] * self._scale
        return rows / np.sqrt(rows.shape[0] * rows.shape[1])

    def quality(self, motion: Trajectory) -> ExcitationScore:
        rows = self.rows(motion).reshape(-1, len(self.base))
        size = np.linalg.svd(rows, compute_uv=False)
        with np.errstate(divide="ignore"):
            condition = float(size[0] / size[-1]) if len(rows) >= rows.shape[1] else np.inf
            determinant = float(2.0 * np.log(size).mean())
        return ExcitationScore(condition, determinant, not_excited(rows, self.base.labels))

    def cost(self, motion: Trajectory, criterion: Criterion) -> float:
        """Return the logarithm of the condition number, or minus that of the determinant."""
        rows = self.rows(motion)
        size = np.linalg.svd(rows.reshape(-1, rows.shape[2]), compute_uv=False)
        size = np.maximum(size, np.finfo(np.float64).tiny)
        if criterion == "condition":
            return float(np.log(size[0] / size[-1]))
        return float(-2.0 * np.log(size).mean())

    def slopes(self, motion: Trajectory, criterion: Criterion) -> Float:
        """Return cost per position, velocity and acceleration of every sample, shape (3, N, n)."""
        rows = self.rows(motion)
        flat = rows.reshape(-1, rows.shape[2])
        left, size, right = np.linalg.svd(flat, full_matrices=False)
        size = np.maximum(size, np.finfo(np.float64).tiny)
        if criterion == "condition":
            slope = np.outer(left[:, 0], right[0]) / size[0]
            slope -= np.outer(left[:, -1], right[-1]) / size[-1]
        else:
            slope = (left / size) @ right * (-2.0 / len(size))
        slope = slope.reshape(rows.shape)
        found = slopes(
            motion, self.limits, lambda moved: (slope * (self.rows(moved) - rows)).sum(axis=(1, 2))
        )
        return found.swapaxes(1, 2)


class ExcitationSettings(Described):
    """How to look for a motion."""

    criterion: Annotated[
        Criterion, "``determinant``, the greatest (D-optimal), or ``condition``, the least number."
    ] = "determinant"
    harmonics: Annotated[int, "Of the Fourier series."] = 5
    period: Annotated[float, "Of the motion. [s]"] = 10.0
    starts: Annotated[int, "Random motions to begin with; the best result is kept."] = 3
    iterations: Annotated[int, "At most, of each."] = 100
    seed: Annotated[int, "Of the starts."] = 0
    columns: Annotated[
        tuple[ParameterColumn, ...], "What is to be fitted in addition to the links."
    ] = field(default_factory=standard_columns, repr=False)

    def __post_init__(self) -> None:
        for name, least in (("starts", 1), ("iterations", 1), ("seed", 0)):
            if getattr(self, name) < least:
                raise MotionError(f"{name} is {getattr(self, name)}", f"a number from {least} on")


KINDS = ("position", "velocity", "acceleration", "torque")


class ExcitedJoint(Result):
    """One joint of the motion."""

    name: Annotated[str, "Name of the joint."]
    start: Annotated[float, "Position at the start. [rad] or [m]"]
    use: Annotated[dict[str, Number], "Share of each limit, by kind; None without a limit. [-]"]


class ExcitationReport(Result, name="excitation"):
    """A motion for the identification of the dynamics."""

    settings: Annotated[ExcitationSettings, "Settings of the search."]
    before: Annotated[ExcitationScore, "How well the best random start does."]
    after: Annotated[ExcitationScore, "How well the optimised motion does."]
    base_parameters: Annotated[
        dict[str, str], "All that a motion can determine: sum of each group by its name."
    ]
    without_effect: Annotated[Texts, "Parameters that no torque depends on."]
    margin: Annotated[float, "Share of every limit that was allowed. [-]"]
    acceleration_assumed: Annotated[bool, "Whether the limits of the acceleration were not given."]
    joints: Annotated[tuple[ExcitedJoint, ...], "In model order."]
    floor: Annotated[Floor | None, "Height that a link keeps; None without one."]
    least_height: Annotated[Number, "Least height that the link reaches; None without a floor. [m]"]
    motion: Annotated[FourierMotion, "The motion."] = field(repr=False)


@one_thread
def optimise_excitation(
    model: RobotModel,
    limits: ExcitationLimits,
    settings: ExcitationSettings | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> ExcitationReport:
    """Return the motion, best of all starts, that determines the base parameters, within limits.

    Args:
        progress: Called with the share done. [-]
    """
    settings = settings or ExcitationSettings()
    basis = FourierBasis(settings.harmonics, settings.period)
    scorer = ExcitationCriterion(model, limits, settings.columns)
    random = np.random.default_rng(settings.seed)
    problem = _Problem(basis, scorer, settings.criterion)
    starts: list[tuple[float, Float]] = []
    ends: list[tuple[float, Float]] = []
    for number in range(settings.starts):
        start = _draw_start(basis, limits, random)
        end = _shrunk(basis, limits, problem.solve(start, settings.iterations))
        starts.append((problem.cost_of(start), start))
        if end is not None:
            ends.append((problem.cost_of(end), end))
        progress((number + 1) / settings.starts)
    ends += starts  # a start that nothing improved on
    weights = min(ends, key=lambda entry: entry[0])[1]
    start = min(starts, key=lambda entry: entry[0])[1]
    motion = FourierMotion(basis, weights)
    fine, base = _finely(motion), scorer.base
    use = {kind: share * limits.margin for kind, share in limits.largest(fine).items()}
    use["torque"] = np.where(np.isfinite(limits.torque), use["torque"], np.nan)
    return ExcitationReport(
        settings=settings,
        before=scorer.quality(problem.motion(start)),
        after=scorer.quality(problem.motion(weights)),
        base_parameters=dict(zip(base.labels, map(base.expression, range(len(base))), strict=True)),
        without_effect=base.without_effect,
        margin=limits.margin,
        acceleration_assumed=limits.acceleration_assumed,
        joints=tuple(
            ExcitedJoint(
                name,
                float(fine.joint_position[0, joint]),
                {kind: known(use[kind][joint]) for kind in KINDS},
            )
            for joint, name in enumerate(limits.robot.joint_names)
        ),
        floor=limits.floor,
        least_height=float(limits.height(fine.joint_position[::10]).min()),
        motion=motion,
    )


def _finely(motion: FourierMotion) -> Trajectory:
    count = round(motion.period * CHECKED_RATE)
    return motion.sample(np.arange(count) * (motion.period / count))


def _breaks(limits: ExcitationLimits, motion: Trajectory) -> float:
    return max(float(use.max()) for use in limits.largest(motion).values())


def _draw_start(
    basis: FourierBasis, limits: ExcitationLimits, random: np.random.Generator
) -> Float:
    count = SAMPLES_PER_HARMONIC * basis.harmonics
    time = np.arange(count) * (basis.period / count)
    for _ in range(MAX_TRIES):
        weights = random.normal(size=(basis.size, limits.robot.n_joints))
        weights[0] = limits.middle + 0.3 * limits.reach * random.uniform(-1.0, 1.0)
        still = np.zeros_like(weights)
        still[0] = weights[0]
        if _breaks(limits, FourierMotion(basis, still).sample(time[:1])) > 1.0:
            continue
        swing = weights.copy()
        swing[0] = limits.middle
        use = limits.largest(FourierMotion(basis, swing).sample(time))
        worst = np.max([use[kind] for kind in ("position", "velocity", "acceleration")], axis=0)
        weights[1:] *= FIRST_USE / worst
        for _ in range(MAX_HALVES):
            if _breaks(limits, FourierMotion(basis, weights).sample(time)) <= 1.0:
                kept = _shrunk(basis, limits, weights)
                if kept is not None:
                    return kept
                break
            weights[1:] *= 0.5
    raise MotionError(
        f"no allowed motion was found in {MAX_TRIES} tries",
        "limits that leave room to move",
        "lower the floor, or check payload and torque limits",
    )


def _shrunk(basis: FourierBasis, limits: ExcitationLimits, weights: Float) -> Float | None:
    """The motion, smaller where it breaks a limit at 1 kHz; None where that does not help."""
    weights = weights.copy()
    for _ in range(MAX_SHRINKS):
        motion = _finely(FourierMotion(basis, weights))
        worst = _breaks(limits, motion)
        if worst <= 1.0:
            return weights
        weights[1:] *= min(SHRINK, 1.0 / worst)
    return None


class _Problem:
    """Cost and limits as functions of free weights, each of the size of its limit."""

    def __init__(
        self, basis: FourierBasis, scorer: ExcitationCriterion, criterion: Criterion
    ) -> None:
        self._scorer, self._limits = scorer, scorer.limits
        self._criterion: Criterion = criterion
        count = SAMPLES_PER_HARMONIC * basis.harmonics
        self._matrices = basis.sample(np.arange(count) * (basis.period / count))
        self._unit = np.tile(scorer.limits.velocity, (basis.size, 1))
        self._unit[0] = scorer.limits.reach

    def motion(self, weights: Float) -> Trajectory:
        return Trajectory(*(matrix @ weights for matrix in self._matrices))

    def cost_of(self, weights: Float) -> float:
        return self._scorer.cost(self.motion(weights), self._criterion)

    def solve(self, start: Float, iterations: int) -> Float:
        """Better weights than those to begin with, shape (2 L - 1, n)."""
        from scipy import optimize

        scorer, limits, criterion = self._scorer, self._limits, self._criterion

        def cost(free: Float) -> float:
            return scorer.cost(self._at(free), criterion)

        def slope(free: Float) -> Float:
            return self._pulled(scorer.slopes(self._at(free), criterion))

        def room(free: Float) -> Float:
            return 1.0 - limits.smooth(self._at(free))[0]

        search: Any = optimize.minimize  # pyright: ignore[reportUnknownMemberType]
        result: Any = search(
            cost,
            (start / self._unit).ravel(),
            jac=slope,
            method="SLSQP",
            constraints={"type": "ineq", "fun": room, "jac": self._room_slope},
            options={"maxiter": iterations, "ftol": PLATEAU},
        )
        return np.asarray(result.x, dtype=np.float64).reshape(self._unit.shape) * self._unit

    def _at(self, free: Float) -> Trajectory:
        return self.motion(free.reshape(self._unit.shape) * self._unit)

    def _room_slope(self, free: Float) -> Float:
        motion = self._at(free)
        _, parts = self._limits.smooth(motion)
        kinds = {kind for kind, _, _ in parts}
        torque = self._limits.torque_slopes(motion) if "torque" in kinds else np.empty(0)
        floor = self._limits.floor_slopes(motion) if "floor" in kinds else np.empty(0)
        own = {
            "position": (0, self._limits.reach),
            "velocity": (1, self._limits.velocity),
            "acceleration": (2, self._limits.acceleration),
        }
        rows: list[Float] = []
        for kind, joint, weight in parts:
            slope = np.zeros((3, *motion.joint_position.shape))
            if kind == "torque":
                slope[:] = (torque[:, :, :, joint] * weight).swapaxes(1, 2)
            elif kind == "floor":
                slope[0] = (floor * weight).T
            else:
                order, limit = own[kind]
                slope[order, :, joint] = weight / limit[joint]
            rows.append(-self._pulled(slope))
        return np.stack(rows)

    def _pulled(self, slope: Float) -> Float:
        """Slope by free weights from the slope by samples."""
        total = sum(matrix.T @ part for matrix, part in zip(self._matrices, slope, strict=True))
        return np.asarray(total * self._unit).ravel()
