"""The laws of viscous friction over temperature, each fitted to samples in motion, and held out.

Everything but the temperature scale of the exponential law is linear; that scale is
searched, and the rest solved for each.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model.figure import PositiveFigure
from robot_energy.model.friction_laws import (
    FRICTION_LAWS,
    ConstantLaw,
    ExponentialLaw,
    LawEntry,
    TableLaw,
)
from robot_energy.model.joint import Stribeck
from robot_energy.physics.friction import viscous_law
from robot_energy.timeline.blocks import Float, Int
from robot_energy_identify.bounds import AT_BOUND, identified
from robot_energy_identify.friction.samples import FrictionData
from robot_energy_identify.stats.cross_validation import (
    HeldOut,
    Mask,
    contiguous_folds,
    folds_by_value,
    held_out,
)
from robot_energy_identify.stats.regression import Fit, regress
from robot_energy_identify.stats.systematic import THERMOMETER, moved_by, with_systematic

NODE_SPACING = 6.0  # K between the nodes of the free curve, at least
MIN_RANGE = 6.0  # K of motor temperature, below which it cannot be distinguished from a constant
MIN_SHARE = 0.02  # of the excitation w^2 that a node must see
SCALES = np.geomspace(4.0, 120.0, 18)  # K, tried for the exponential law
MIN_SPEED_RATIO = 1.5  # of fast to slow motion, that separates viscous from Coulomb friction
FALLING_SPEEDS = (0.02, 0.9)  # quantiles of the speed between which ws is looked for
FALLING_STEPS = 16  # of ws
GRID = 25  # temperatures at which the deviation of a law is looked for
IMPOSSIBLE = 1e30  # cost of a law with a negative part; finite, for the search


def _nodes(data: FrictionData) -> Float:
    """Nodes of the free curve, where the data are: one per stretch of temperature seen."""
    degc, moved = data.motor_temperature_degc, data.turning**2
    low, high = float(degc.min()), float(degc.max())
    if high - low < MIN_RANGE:
        return np.array([float(np.average(degc, weights=moved))])
    count = max(int((high - low) / NODE_SPACING), 2)
    stretch = np.minimum(((degc - low) / (high - low) * count).astype(np.int64), count - 1)
    seen = np.bincount(stretch, weights=moved, minlength=count)
    centre = np.bincount(stretch, weights=moved * degc, minlength=count)
    kept = np.flatnonzero(seen >= MIN_SHARE * seen.sum())
    nodes = centre[kept] / seen[kept]
    apart = np.append(True, np.diff(nodes) > 0.5 * NODE_SPACING)
    return nodes[apart]


def _columns(data: FrictionData, shape: Float) -> Float:
    """Columns of fc, of ``shape * w``, of the offset and of the nuisances."""
    ones = np.ones((len(data), 1))
    viscous = shape * data.turning[:, None]
    return np.hstack([data.sign[:, None], viscous, ones, data.nuisance])


def regress_friction(data: FrictionData, shape: Float, names: Sequence[str]) -> Fit:
    """Return the fit of fc, of the coefficients of ``shape * w``, of an offset and the nuisances.

    Args:
        shape: Shape (N, K). [-]
    """
    extra = [f"gravity term {number + 1}" for number in range(data.nuisance.shape[1])]
    if data.loaded:
        extra[0] = "load"
    if data.exponent_free:
        extra[-1] = "exponent of the speed"
    try:
        columns = _columns(data, shape)
        fit = regress(
            columns,
            data.friction_torque,
            data.block,
            ["Coulomb", *names, "offset", *extra],
            data.method,
            f"the motions of {data.name}",
            data.deviations,
        )
        if not data.deviations or data.changes is None:
            return fit
        changes = zip(data.causes, data.changes.T, strict=True)
        return with_systematic(fit, columns, {cause: (change,) for cause, change in changes})
    except NotIdentifiableError as error:
        if one_speed(data):
            raise _one_speed(data) from error
        raise


def one_speed(data: FrictionData) -> bool:
    """Whether an axis moves at nearly one speed, so that ``fc`` and ``fv w`` look alike."""
    slow, fast = np.quantile(np.abs(data.motor_velocity), (0.1, 0.9))
    return bool(fast < MIN_SPEED_RATIO * slow)


def _one_speed(data: FrictionData) -> NotIdentifiableError:
    speed = float(np.median(np.abs(data.motor_velocity)))
    return NotIdentifiableError(
        f"{data.name} moves at one speed, {speed:.3g} rad/s: Coulomb and viscous friction cannot "
        "be separated",
        f"speeds that differ by a factor of {MIN_SPEED_RATIO:g} or more",
        "record slow and fast motions in both directions",
    )


def nuisance(fit: Fit, data: FrictionData) -> Float:
    """Return the torque of offset and nuisances of a fit, at other samples, shape (N,)."""
    columns = np.hstack([np.ones((len(data), 1)), data.nuisance])
    return columns @ fit.values[-columns.shape[1] :]


def fit_law(name: str, data: FrictionData, source: str = "") -> tuple[LawEntry, Fit]:
    """Return a law and the regression behind it: fc first, then fv, the offset, the nuisances.

    Raises:
        NotIdentifiableError: If they do not determine its parameters or have another shape, or the
            law has no fit.
    """
    fit = FRICTION_LAWS[name].fit
    if fit is None:
        raise NotIdentifiableError(f"the friction law '{name}' has no fit", "a law with a fit")
    return fit(data, source)


def fit_constant(data: FrictionData, source: str) -> tuple[ConstantLaw, Fit]:
    """Return one viscous coefficient for all temperatures, and its regression."""
    if one_speed(data):
        fit = _without_viscous(regress_friction(data, np.empty((len(data), 0)), []))
        low, high = np.quantile(np.abs(data.motor_velocity), (0.1, 0.9))
        text = f"in the Coulomb torque, which holds at {low:.3g} to {high:.3g} rad/s"
        text += f": {source}" if source else ""
        none = PositiveFigure(value=0.0, tag="assumed", source=text)
        return constant_law(none, data.motor_temperature_degc), fit
    fit = regress_friction(data, np.ones((len(data), 1)), ["viscous"])
    value, std = float(fit.values[1]), float(fit.std[1])
    return constant_law(identified(value, std, source), data.motor_temperature_degc), fit


def constant_law(viscous: PositiveFigure, degc: Float) -> ConstantLaw:
    """Return a constant for the temperatures of its samples, and for those next to them.

    Args:
        degc: Of the samples; NaN where they are not known, shape (N,). [degC]
    """
    low, high = float(np.min(degc)), float(np.max(degc))
    fitted = (round(min(low, high - MIN_RANGE), 1), round(max(high, low + MIN_RANGE), 1))
    known = bool(np.isfinite([low, high]).all())
    return ConstantLaw(law="constant", viscous=viscous, fitted_degc=fitted if known else None)


def _without_viscous(fit: Fit) -> Fit:
    """A fit that had no viscous column, with one that is 0 behind Coulomb."""
    return replace(
        fit,
        names=(*fit.names[:1], "viscous", *fit.names[1:]),
        values=np.insert(fit.values, 1, 0.0),
        covariance=np.insert(np.insert(fit.covariance, 1, 0.0, axis=0), 1, 0.0, axis=1),
        parts={cause: np.insert(part, 1, 0.0) for cause, part in fit.parts.items()},
        moves={cause: np.insert(moves, 1, 0.0, axis=0) for cause, moves in fit.moves.items()},
    )


def fit_falling(data: FrictionData, source: str) -> tuple[ConstantLaw, Fit, Stribeck]:
    """Return friction that falls with speed: Coulomb, viscous and a Stribeck term.

    ``torque = (fc + fs exp(-(|w|/ws)^2)) s(w) + fv w + offset + nuisances``; ws is searched among
    the speeds of the motion.

    Returns:
        The viscous coefficient, which is 0 where it would be negative; the regression: fc, fv, fs,
        offset, nuisances; the term.

    Raises:
        NotIdentifiableError: If the motion does not separate them, or friction does not fall.
    """
    speed = np.abs(data.motor_velocity)
    tried: list[tuple[float, float, bool]] = []
    slow, fast = (float(np.quantile(speed, share)) for share in FALLING_SPEEDS)
    for velocity in map(float, np.geomspace(slow, fast, FALLING_STEPS)):
        for viscous in (True, False):
            columns = _columns(data, _falling_shape(data, velocity, viscous))
            values, *_ = np.linalg.lstsq(columns, data.friction_torque)
            if (values[: 2 + viscous] >= 0.0).all():
                error = data.friction_torque - columns @ values
                tried.append((float(error @ error), velocity, viscous))
                break
    if not tried:
        raise NotIdentifiableError(
            f"the friction of {data.name} falls with speed in another way than a Stribeck term "
            "does",
            "a fall towards a Coulomb torque >= 0",
        )
    _, velocity, viscous = min(tried)
    names = ["viscous", "Stribeck"] if viscous else ["Stribeck"]
    fit = regress_friction(data, _falling_shape(data, velocity, viscous), names)
    fit = fit if viscous else _without_viscous(fit)
    (value, torque), (std, torque_std) = fit.values[1:3].tolist(), fit.std[1:3].tolist()
    term = Stribeck(
        torque=identified(torque, torque_std, source),
        velocity=PositiveFigure(value=velocity, tag="identified", source=source),
    )
    law = constant_law(identified(value, std, source), data.motor_temperature_degc)
    return law, fit, term


def _falling_shape(data: FrictionData, velocity: float, viscous: bool) -> Float:
    """What is multiplied by w: 1 for the viscous term, and the Stribeck term over w."""
    speed = data.motor_velocity
    falling = stribeck(data, velocity) / np.where(speed == 0.0, 1.0, speed)
    return np.column_stack([np.ones(len(data)), falling] if viscous else [falling])


def stribeck(data: FrictionData, velocity: float) -> Float:
    """Return the Stribeck term for a torque of 1 N m, shape (N,). [-]

    Args:
        velocity: ws, motor side. [rad/s]
    """
    return data.sign * np.exp(-((data.motor_velocity / velocity) ** 2))


def fit_table(data: FrictionData, source: str) -> tuple[TableLaw, Fit]:
    """Return the free curve over temperature, and its regression."""
    degc, nodes = data.motor_temperature_degc, _nodes(data)
    if len(nodes) < 2:
        raise NotIdentifiableError(
            f"its motion at {degc.min():.0f} to {degc.max():.0f} degC lies at one place only, and "
            f"a table needs two that are {0.5 * NODE_SPACING:g} K apart",
            "motion spread over the temperatures",
        )
    # weights of linear interpolation between the nodes; each row sums to 1
    hats = np.stack([np.interp(degc, nodes, row) for row in np.eye(len(nodes))], axis=1)
    fit = regress_friction(data, hats, [f"viscous at {node:.0f} degC" for node in nodes])
    slope = np.zeros(len(fit.values))
    slope[1 : 1 + len(nodes)] = np.gradient(fit.values[1 : 1 + len(nodes)], nodes)
    fit = moved_by(fit, THERMOMETER, data.thermometer * slope)
    values = fit.values[1 : 1 + len(nodes)]
    std = fit.std[1 : 1 + len(nodes)] if data.deviations else None
    return table_law(nodes, values, std, source), fit


def table_law(nodes: Float, viscous: Float, std: Float | None, source: str) -> TableLaw:
    """Return a table of what was fitted at some temperatures, nothing below 0.

    Args:
        nodes: Temperatures, shape (K,). [degC]
        viscous: Fitted there, shape (K,). [N m s/rad]
        std: Of each; None where it does not show, shape (K,). [N m s/rad]
    """
    above = viscous > 0.0
    below = ", ".join(f"{node:.0f}" for node in nodes[~above])
    return TableLaw(
        law="table",
        motor_temperature_degc=[round(float(node), 3) for node in nodes],
        viscous=[max(float(value), 0.0) for value in viscous],
        std=None if std is None else std.tolist(),
        tag="identified" if above.any() else "assumed",
        source=source if above.all() else f"{AT_BOUND} at {below} degC: {source}",
    )


def fit_exponential(data: FrictionData, source: str) -> tuple[ExponentialLaw, Fit]:
    """Return the exponential law, whose scale c is searched, and its regression."""
    degc = data.motor_temperature_degc
    middle = float(degc.mean())
    free = fit_constant if len(_nodes(data)) < 2 else fit_table
    root = free(replace(data, deviations=False), "")[1].weight
    # both sides behind a QR decomposition of what no scale changes: only its rest is left of them
    fixed = _columns(data, np.ones((len(data), 1))) * root[:, None]
    base, triangle = np.linalg.qr(fixed)
    target, speed = root * data.friction_torque, root * data.turning
    along = base.T @ target
    rest = target - base @ along

    def decay(scale: float) -> Float:
        return np.exp(-(degc - middle) / scale)

    def cost(scale: float) -> float:
        column = decay(scale) * speed
        inside = base.T @ column
        outside = column - base @ inside
        cold = float(outside @ rest) / max(float(outside @ outside), np.finfo(float).tiny)
        hot = np.linalg.solve(triangle, along - cold * inside)[1]
        if hot < 0 or cold < 0:
            return IMPOSSIBLE
        left = rest - cold * outside
        return float(left @ left)

    costs = [cost(float(scale)) for scale in SCALES]
    best = int(np.argmin(costs))
    if costs[best] == IMPOSSIBLE:
        if one_speed(data):
            raise _one_speed(data)
        raise NotIdentifiableError(
            "the viscous friction does not fall with temperature towards a limit >= 0",
            "points that do",
        )
    from scipy.optimize import minimize_scalar

    low, high = SCALES[max(best - 1, 0)], SCALES[min(best + 1, len(SCALES) - 1)]
    refined = float(minimize_scalar(cost, bounds=(low, high), method="bounded").x)
    scale = refined if cost(refined) <= costs[best] else float(SCALES[best])
    shape = np.stack([np.ones(len(degc)), decay(scale)], axis=1)
    found = regress_friction(data, shape, ["hot viscous", "cold viscous"])
    hot, cold = (max(float(value), 0.0) for value in found.values[1:3])
    tangent = _tangent(data, found, cold, scale, middle) if data.deviations else None
    known = None if tangent is None else tangent.covariance[1:4, 1:4]
    law = exponential_law((hot, cold, scale), middle, degc, known, source)
    return law, found if tangent is None else _with_coulomb_of(found, tangent)


def exponential_law(
    figures: tuple[float, float, float],
    middle: float,
    degc: Float,
    known: Float | None,
    source: str,
) -> ExponentialLaw:
    """Return the law ``hot + cold exp(-(T - middle) / c)`` of samples at some temperatures.

    Args:
        figures: hot and cold [N m s/rad], and c [K].
        middle: [degC]
        degc: Of the samples, shape (N,). [degC]
        known: Covariance of the figures, shape (3, 3), None where it does not show.
            [units of the figures]
    """
    hot, cold, scale = figures
    lift = float(np.exp(middle / scale))
    # of a, of b = cold exp(middle / c), and of c
    to_law = np.array(
        [[1.0, 0.0, 0.0], [0.0, lift, -cold * lift * middle / scale**2], [0.0, 0.0, 1.0]]
    )
    covariance, std = None, [None, None, None]
    if known is not None:
        with np.errstate(invalid="ignore"):  # an infinite variance makes NaN, and no covariance
            known = to_law @ known @ to_law.T
        known = 0.5 * (known + known.T)  # without what rounding made unequal
        if np.isfinite(known).all():
            covariance, std = known.tolist(), np.sqrt(np.diag(known)).tolist()
    law = ExponentialLaw(
        law="exponential",
        a=identified(hot, std[0], source),
        b=identified(cold * lift, std[1], source),
        c=PositiveFigure(value=scale, tag="identified", std=std[2], source=source),
        fitted_degc=(float(degc.min()), float(degc.max())),
        covariance=covariance,
    )
    if covariance is None:
        return law
    greatest = viscous_law(law).std(np.linspace(*law.fitted_degc, GRID)).max()
    return law.model_copy(update={"std": float(greatest)})


def _tangent(data: FrictionData, fit: Fit, cold: float, scale: float, middle: float) -> Fit | None:
    """The fit with c as one more column, for the covariance; None where it does not show.

    Its columns behind Coulomb are a, the cold part at the middle temperature, and c.
    """
    degc = data.motor_temperature_degc
    decay = np.exp(-(degc - middle) / scale)
    shape = np.stack([np.ones(len(degc)), decay, cold * decay * (degc - middle) / scale**2], axis=1)
    try:
        tangent = regress_friction(
            replace(data, friction_torque=fit.residual), shape, ["hot", "cold", "scale"]
        )
    except NotIdentifiableError:
        return None
    moves = np.zeros(len(tangent.values))
    moves[2] = -cold / scale * data.thermometer  # of the law at the true temperature
    return moved_by(tangent, THERMOMETER, moves)


def _with_coulomb_of(fit: Fit, tangent: Fit) -> Fit:
    """A fit with the deviation that its Coulomb torque has while c is free."""
    covariance, parts = fit.covariance.copy(), {}
    covariance[0, 0] = tangent.covariance[0, 0]
    for cause, part in tangent.parts.items():
        own = fit.parts.get(cause, np.zeros(len(fit.values))).copy()
        own[0] = part[0]
        parts[cause] = own
    return replace(fit, covariance=covariance, parts=parts)


def fitted_laws() -> tuple[str, ...]:
    """Names of the laws that have a fit, the simplest first."""
    return tuple(name for name, kind in FRICTION_LAWS.items() if kind.fit is not None)


HeldOutPart = Literal["temperatures", "blocks"]


def held_out_law(
    fit: Callable[[FrictionData], tuple[LawEntry, Fit]], data: FrictionData, fold: Int
) -> HeldOut:
    """Return the error of a law on folds that its fit has not seen.

    The nuisances and the offset of the test samples come from the training samples too.

    Args:
        fold: Of each sample, shape (N,).
    """
    data = replace(data, deviations=False)

    def predict(train: Mask, test: Mask) -> Float:
        return law_torque(*fit(data[train]), data[test])

    return held_out(data.friction_torque, fold, predict)


def law_torque(law: LawEntry, fit: Fit, seen: FrictionData) -> Float:
    """Return the torque of a fitted law at other samples, shape (N,). [N m]"""
    degc = np.nan_to_num(seen.motor_temperature_degc)  # without any, the law is a constant
    viscous = viscous_law(law).viscous(degc)
    return fit.values[0] * seen.sign + viscous * seen.turning + nuisance(fit, seen)


def folds_of_axis(data: FrictionData) -> tuple[HeldOutPart, Int]:
    """Return what is held out (temperatures or blocks in time) and each sample's fold, (N,)."""
    degc = data.motor_temperature_degc
    fold = folds_by_value(degc)
    if len(np.unique(fold)) < 2 or not float(np.ptp(degc)) >= MIN_RANGE:
        # One thermal state: a fold by temperature would be a few motions, perhaps all one way.
        number = np.unique(data.block, return_inverse=True)[1]
        return "blocks", contiguous_folds(int(number.max()) + 1)[number]
    return "temperatures", fold
