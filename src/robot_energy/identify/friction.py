"""Friction of one axis over motor temperature, from measured torque (paper A, eq. 8 to 10).

``measured - rigid = fc s(w) + fv(T) w + offset + nuisances``, motor side, in samples
where the axis moves. fc does not know temperature. fv is first left free: straight
between nodes on the temperature axis, every sample counting at its own temperature, so
that a drift during a measurement does no harm. Then the laws that a model file knows
compete on temperatures they have not seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from robot_energy.blocks import Float
from robot_energy.errors import NotIdentifiableError
from robot_energy.friction import viscous_law
from robot_energy.identify.friction_data import FrictionData
from robot_energy.identify.quality import HeldOut, folds_by_value, held_out
from robot_energy.identify.regression import Regression, regress
from robot_energy.model_file import RobotModel
from robot_energy.model_file.figure import PositiveFigure
from robot_energy.model_file.joint import ConstantLaw, ExponentialLaw, JointFriction, TableLaw

LawName = Literal["constant", "exponential", "table"]
Law = ConstantLaw | ExponentialLaw | TableLaw

NODE_SPACING = 6.0  # K between the nodes of the free curve, at least
LEAST_RANGE = 6.0  # K of motor temperature, below which it cannot be told from a constant
LEAST_SHARE = 0.02  # of the excitation w^2 that a node must see
LEAST_SAMPLES = 200
FOLDS = 5
SCALES = np.geomspace(4.0, 120.0, 18)  # K, tried for the exponential law
IMPOSSIBLE = 1e30  # cost of a law with a negative part; finite, for the search
SPEED_SHARE = 0.03  # of the greatest speed: below it Stribeck friction reigns
GAIN = 0.98  # a law with more parameters must be better than a simpler one by this factor


@dataclass(frozen=True)
class Point:
    """Viscous coefficient at one temperature, before any law.

    Attributes:
        motor_temperature_degc: [degC]
        viscous: Motor side. [N m s/rad]
        std: [N m s/rad]
    """

    motor_temperature_degc: float
    viscous: float
    std: float


@dataclass(frozen=True)
class FrictionFit:
    """Friction of one axis.

    Attributes:
        name: Of the joint.
        coulomb: fc, motor side. [N m]
        coulomb_std: [N m]
        points: The free curve of fv.
        laws: Every law that could be fitted.
        errors: Of each law on temperatures it has not seen.
        chosen: The law with the least held-out error.
        samples: Number of samples used.
        range_degc: Of the motor temperature in them. [degC]
        residual: Root mean square of what remains of the chosen law, in sample. [N m]
        warnings: What the data cannot tell, one sentence each.
    """

    name: str
    coulomb: float
    coulomb_std: float
    points: tuple[Point, ...]
    laws: dict[LawName, Law]
    errors: dict[LawName, HeldOut]
    chosen: LawName
    samples: int
    range_degc: tuple[float, float]
    residual: float
    warnings: tuple[str, ...]

    @property
    def law(self) -> Law:
        """The chosen law."""
        return self.laws[self.chosen]

    def entry(self, before: JointFriction, source: str) -> JointFriction:
        """Return the friction of a model file with these figures.

        Args:
            before: What the file held; its optional terms stay.
            source: Where the data come from.
        """
        coulomb = PositiveFigure(
            value=max(self.coulomb, 0.0), tag="identified", std=self.coulomb_std, source=source
        )
        return before.model_copy(update={"coulomb": coulomb, "viscous": self.law})


def fit_friction(data: FrictionData, source: str = "") -> FrictionFit:
    """Identify the friction of one axis.

    Args:
        data: Its samples, from one or several recordings.
        source: Where they come from, for the model file.

    Returns:
        The fit.

    Raises:
        NotIdentifiableError: If the axis hardly moves, only in one direction or at one
            speed, or no temperature is known.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):  # the matrices are small: more threads only wait for each other
        return _fit(moving_samples(data), source)


def _fit(moving: FrictionData, source: str) -> FrictionFit:
    degc = moving.motor_temperature_degc
    span = (float(degc.min()), float(degc.max()))
    warnings: list[str] = []
    names: tuple[LawName, ...] = ("constant", "exponential", "table")
    if span[1] - span[0] < LEAST_RANGE:
        names = ("constant",)
        warnings.append(
            f"{moving.name}: the motor was at {span[0]:.1f} to {span[1]:.1f} degC only, so its "
            "friction is taken as constant; record it cold and warm, at least "
            f"{LEAST_RANGE:g} K apart"
        )
    laws: dict[LawName, Law] = {}
    fits: dict[LawName, Regression] = {}
    errors: dict[LawName, HeldOut] = {}
    for name in names:
        try:
            laws[name], fits[name] = fit_law(name, moving, source)
            errors[name] = _held_out(name, moving)
        except NotIdentifiableError as error:
            if name == "constant":
                raise
            warnings.append(f"{moving.name}: no {name} law, because {error.found}")
    chosen = _choose(errors)
    regression = fits[chosen]
    coulomb = float(regression.values[0])
    if coulomb < 0:
        warnings.append(
            f"{moving.name}: the Coulomb torque is negative ({coulomb:.3g}) and set to 0; "
            "check the sign and the meaning of the measured torque"
        )
    return FrictionFit(
        name=moving.name,
        coulomb=coulomb,
        coulomb_std=float(regression.std[0]),
        points=_points(laws, span),
        laws=laws,
        errors=errors,
        chosen=chosen,
        samples=len(moving),
        range_degc=span,
        residual=float(np.sqrt(np.mean(regression.residual**2))),
        warnings=tuple(warnings),
    )


def moving_samples(data: FrictionData) -> FrictionData:
    """Leave out rest, slow motion and samples with something missing.

    Raises:
        NotIdentifiableError: If too little is left, or a channel is missing.
    """
    known = np.isfinite(data.friction_torque) & np.isfinite(data.motor_velocity)
    if not known.any():
        raise NotIdentifiableError(
            f"{data.name} has no measured torque",
            "effort in the joint states",
            "say what it means with --effort",
        )
    warm = np.isfinite(data.motor_temperature_degc)
    if not (known & warm).any():
        raise NotIdentifiableError(
            f"no motor temperature of {data.name} is known",
            "temperatures beside the joint states",
            "name their topic with --inputs",
        )
    speed = np.abs(data.motor_velocity)
    fastest = float(np.quantile(speed[known], 0.999))
    rows = known & warm & (speed > SPEED_SHARE * fastest) & (speed > 0)
    moving = data.rows(rows)
    if len(moving) < LEAST_SAMPLES:
        raise NotIdentifiableError(
            f"{data.name} moves in {len(moving)} of {len(data)} samples",
            f"at least {LEAST_SAMPLES} in motion",
            "record motions of this joint at several speeds and in both directions",
        )
    return moving


def _nodes(data: FrictionData) -> Float:
    """Nodes of the free curve, where the data are: one per stretch of temperature seen."""
    degc, moved = data.motor_temperature_degc, data.motor_velocity**2
    low, high = float(degc.min()), float(degc.max())
    if high - low < LEAST_RANGE:
        return np.array([float(np.average(degc, weights=moved))])
    count = max(int((high - low) / NODE_SPACING), 2)
    stretch = np.minimum(((degc - low) / (high - low) * count).astype(np.int64), count - 1)
    seen = np.bincount(stretch, weights=moved, minlength=count)
    centre = np.bincount(stretch, weights=moved * degc, minlength=count)
    kept = np.flatnonzero(seen >= LEAST_SHARE * seen.sum())
    nodes = centre[kept] / seen[kept]
    apart = np.append(True, np.diff(nodes) > 0.5 * NODE_SPACING)
    return nodes[apart]


def _hats(degc: Float, nodes: Float) -> Float:
    """Weights of linear interpolation between nodes, shape (N, K); each row sums to 1."""
    if len(nodes) == 1:
        return np.ones((len(degc), 1))
    return np.stack([np.interp(degc, nodes, row) for row in np.eye(len(nodes))], axis=1)


def _columns(data: FrictionData, shape: Float) -> Float:
    """Columns of fc, of ``shape * w``, of the offset and of the nuisances."""
    ones = np.ones((len(data), 1))
    viscous = shape * data.motor_velocity[:, None]
    return np.hstack([data.sign[:, None], viscous, ones, data.nuisance])


def _regress(data: FrictionData, shape: Float, names: Sequence[str]) -> Regression:
    """Fit fc, the coefficients of ``shape * w``, an offset and the nuisances."""
    extra = [f"nuisance {number + 1}" for number in range(data.nuisance.shape[1])]
    return regress(
        _columns(data, shape),
        data.friction_torque,
        data.block,
        ["Coulomb", *names, "offset", *extra],
        what=f"the motions of {data.name}",
    )


def _points(laws: dict[LawName, Law], span: tuple[float, float]) -> tuple[Point, ...]:
    """The free curve: the table where there is one, else the constant."""
    table, constant = laws.get("table"), laws["constant"]
    if isinstance(table, TableLaw):
        return tuple(
            Point(degc, viscous, std)
            for degc, viscous, std in zip(
                table.motor_temperature_degc, table.viscous, table.std or [], strict=True
            )
        )
    if not isinstance(constant, ConstantLaw):
        return ()
    figure = constant.viscous
    return (Point(0.5 * (span[0] + span[1]), figure.value, figure.std or 0.0),)


def fit_law(name: LawName, data: FrictionData, source: str = "") -> tuple[Law, Regression]:
    """Fit one law.

    Args:
        name: The law.
        data: Samples in motion.
        source: Where they come from, for the model file.

    Returns:
        The law and the regression behind it: fc first, then fv, the offset, the nuisances.

    Raises:
        NotIdentifiableError: If they do not tell its parameters or have another shape.
    """
    degc = data.motor_temperature_degc
    if name == "constant":
        fit = _regress(data, np.ones((len(data), 1)), ["viscous"])
        value, std = float(fit.values[1]), float(fit.std[1])
        figure = PositiveFigure(value=max(value, 0.0), tag="identified", std=std, source=source)
        return ConstantLaw(law="constant", viscous=figure), fit
    if name == "table":
        nodes = _nodes(data)
        if len(nodes) < 2:
            raise NotIdentifiableError("one temperature makes no table", "several")
        fit = _regress(data, _hats(degc, nodes), [f"viscous at {node:.0f} degC" for node in nodes])
        table = TableLaw(
            law="table",
            motor_temperature_degc=[round(float(node), 3) for node in nodes],
            viscous=[max(float(value), 0.0) for value in fit.values[1 : 1 + len(nodes)]],
            std=[float(value) for value in fit.std[1 : 1 + len(nodes)]],
            tag="identified",
            source=source,
        )
        return table, fit
    return _fit_exponential(data, source)


def _fit_exponential(data: FrictionData, source: str) -> tuple[ExponentialLaw, Regression]:
    """Search the temperature scale c; everything else is linear for a given c."""
    degc = data.motor_temperature_degc
    middle = float(degc.mean())
    weight = fit_law("constant" if len(_nodes(data)) < 2 else "table", data)[1].weight
    fixed = _columns(data, np.ones((len(data), 1)))
    root = np.sqrt(weight)

    def decay(scale: float) -> Float:
        return np.exp(-(degc - middle) / scale)

    def cost(scale: float) -> float:
        columns = np.column_stack([fixed, decay(scale) * data.motor_velocity]) * root[:, None]
        values, *_ = np.linalg.lstsq(columns.T @ columns, columns.T @ (root * data.friction_torque))
        if values[1] < 0 or values[-1] < 0:
            return IMPOSSIBLE
        residual = root * data.friction_torque - columns @ values
        return float(residual @ residual)

    costs = [cost(float(scale)) for scale in SCALES]
    best = int(np.argmin(costs))
    if costs[best] == IMPOSSIBLE:
        raise NotIdentifiableError(
            "the viscous friction does not fall with temperature towards a limit >= 0",
            "points that do",
        )
    from scipy.optimize import minimize_scalar

    low, high = SCALES[max(best - 1, 0)], SCALES[min(best + 1, len(SCALES) - 1)]
    refined = float(minimize_scalar(cost, bounds=(low, high), method="bounded").x)
    scale = refined if cost(refined) <= costs[best] else float(SCALES[best])
    shape = np.stack([np.ones(len(degc)), decay(scale)], axis=1)
    found = _regress(data, shape, ["hot viscous", "cold viscous"])
    hot, cold = (max(float(value), 0.0) for value in found.values[1:3])
    std = _exponential_std(data, found, cold, scale, middle)
    lift = float(np.exp(middle / scale))
    law = ExponentialLaw(
        law="exponential",
        a=PositiveFigure(value=hot, tag="identified", std=std["hot"], source=source),
        b=PositiveFigure(value=cold * lift, tag="identified", std=std["zero"], source=source),
        c=PositiveFigure(value=scale, tag="identified", std=std["scale"], source=source),
        fitted_degc=(float(degc.min()), float(degc.max())),
    )
    return law, found


def _exponential_std(
    data: FrictionData, fit: Regression, cold: float, scale: float, middle: float
) -> dict[str, float | None]:
    """Deviations of a, b and c, with c as one more column; None where the data tell none.

    b is the cold part carried to 0 degC: ``b = cold exp(middle/c)``.
    """
    degc = data.motor_temperature_degc
    decay = np.exp(-(degc - middle) / scale)
    shape = np.stack([np.ones(len(degc)), decay, cold * decay * (degc - middle) / scale**2], axis=1)
    try:
        tangent = _regress(
            replace(data, friction_torque=fit.residual), shape, ["hot", "cold", "scale"]
        )
    except NotIdentifiableError:
        return {"hot": None, "zero": None, "scale": None}
    lift = np.exp(middle / scale)
    slope = np.array([lift, -cold * lift * middle / scale**2])
    variance = float(slope @ tangent.covariance[2:4, 2:4] @ slope)
    deviations = {
        "hot": float(tangent.std[1]),
        "zero": float(np.sqrt(variance)),
        "scale": float(tangent.std[3]),
    }
    return {key: value if np.isfinite(value) else None for key, value in deviations.items()}


def _held_out(name: LawName, data: FrictionData) -> HeldOut:
    """Error of a law on temperature ranges that its fit has not seen.

    The nuisances and the offset of the test samples come from the training samples too.
    """
    fold = folds_by_value(data.motor_temperature_degc, FOLDS)
    if len(np.unique(fold)) < 2:
        fold = np.unique(data.block, return_inverse=True)[1] * FOLDS // (data.block.max() + 1)

    def predict(train: NDArray[np.bool_], test: NDArray[np.bool_]) -> Float:
        law, fit = fit_law(name, data.rows(train))
        seen = data.rows(test)
        viscous = viscous_law(law).viscous(seen.motor_temperature_degc)
        first = len(fit.values) - 1 - data.nuisance.shape[1]
        rest = np.hstack([np.ones((len(seen), 1)), seen.nuisance]) @ fit.values[first:]
        return fit.values[0] * seen.sign + viscous * seen.motor_velocity + rest

    return held_out(data.friction_torque, fold, predict)


def _choose(errors: dict[LawName, HeldOut]) -> LawName:
    """The simplest law that no other beats by a margin on unseen temperatures."""
    chosen: LawName = "constant"
    for name in ("exponential", "table"):
        if name in errors and errors[name].rms < GAIN * errors[chosen].rms:
            chosen = name
    return chosen


def with_friction(model: RobotModel, fits: Sequence[FrictionFit], source: str) -> RobotModel:
    """Return a model with identified friction; axes that were not identified keep theirs.

    Args:
        model: Any model of the same robot.
        fits: One per identified axis.
        source: Where the data come from.
    """
    found = {fit.name: fit for fit in fits}
    joints = [
        joint.model_copy(update={"friction": found[joint.name].entry(joint.friction, source)})
        if joint.name in found
        else joint
        for joint in model.joints
    ]
    return model.model_copy(update={"joints": joints}).with_urdf(model.urdf_xml, model.source)
