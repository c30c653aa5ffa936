"""One friction model from the merged sums of all bags of a fleet, as `identify friction` fits it.

The offset of a bag and what a wrong payload adds to it are fitted in every bag by
itself and taken off. What is left is one fit of ``fc sgn(w) + fv(T) w`` for all robots, with fv
at the nodes of temperature. Deviations come from leaving out one robot after the other (or one
bag, where there are few robots), and from the constant errors of sensors.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
import polars as pl

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.model.friction_laws import FRICTION_LAWS, FrictionLaw, LawEntry
from robot_energy.physics.friction import viscous_law
from robot_energy.timeline.blocks import Int
from robot_energy_fleet.bag_joints import (
    COLUMNS,
    MEASURED,
    MODEL,
    NODES_DEGC,
    SIGN,
    VISCOUS,
    bag_joints,
    sums_of_joint,
)
from robot_energy_fleet.findings import compare
from robot_energy_fleet.merged_laws import JointBags, MergedSums, without_nuisances
from robot_energy_fleet.report import duty_of
from robot_energy_fleet.results.fleet import FleetFriction, FleetTorqueScore
from robot_energy_fleet.tables import FleetTables
from robot_energy_identify.friction.friction import FrictionFit, points_of, with_friction
from robot_energy_identify.friction.laws import MIN_RANGE
from robot_energy_identify.friction.samples import MIN_SAMPLES, bodies_identified
from robot_energy_identify.plausibility import check_friction
from robot_energy_identify.provenance import identified_from
from robot_energy_identify.stats.cross_validation import (
    HeldOut,
    contiguous_folds,
    folds_by_value,
    simplest,
)
from robot_energy_identify.stats.regression import Fit
from robot_energy_identify.stats.systematic import DEFAULT_LIMITS, SensorLimits

MIN_GROUPS = 5  # robots, from which on they are left out one by one
MIN_INDEPENDENT = 0.01  # share of w^2 that its sign does not explain


class TorqueScore(Described):
    """Error of a friction model on bags."""

    rms: Annotated[float, "Of the torque. [N m]"]
    relative: Annotated[float, "Norm of the error over that of the friction torque. [-]"]
    energy_error: Annotated[float, "Predicted over measured friction energy, less 1. [-]"]


def fit_merged(
    bags: JointBags, sensors: SensorLimits, own_bodies: bool, source: str
) -> FrictionFit:
    """Return the friction of one joint, as `identify friction` gives it."""
    _require(bags)
    warnings: list[str] = []
    span = (float(bags.degc.min()), float(bags.degc.max()))
    kinds = dict(FRICTION_LAWS)
    if not span[1] - span[0] >= MIN_RANGE:
        kinds = {name: kind for name, kind in kinds.items() if not kind.follows_temperature}
        warnings.append(
            f"{bags.name}: no motor temperature is known, so its friction is a constant, that of "
            "the temperatures at which it was recorded"
            if np.isnan(span[0])
            else f"{bags.name}: the range of its motor temperature is below {MIN_RANGE:g} K, so "
            "its friction is taken as constant"
        )
        fold = contiguous_folds(len(bags.degc))
    else:
        fold = folds_by_value(bags.degc)
    merged = _merge(bags, sensors, own_bodies, source)
    laws: dict[str, LawEntry] = {}
    fits: dict[str, Fit] = {}
    errors: dict[str, HeldOut] = {}
    for name, kind in kinds.items():
        try:
            laws[name], fits[name] = _fitted(kind, merged)
            errors[name] = _held_out(kind, merged, fold)
        except NotIdentifiableError as error:
            if name == "constant":
                raise
            warnings.append(f"{bags.name}: no {name} law, because {error.found}")
            laws.pop(name, None)
    chosen = simplest({name: error.rms for name, error in errors.items()})
    fit, constant, whole = fits[chosen], fits["constant"], merged.whole
    samples = int(bags.rows.sum())
    speed, torque = (
        float(np.sqrt(square / samples))
        for square in (whole[VISCOUS, VISCOUS].sum(), whole[MEASURED, MEASURED])
    )
    return FrictionFit(
        name=bags.name,
        coulomb=float(fit.values[0]),
        coulomb_std=float(fit.std[0]),
        points=points_of(laws, span),
        laws=laws,
        errors=errors,
        chosen=chosen,
        samples=samples,
        range_degc=span,
        residual=score(bags, laws[chosen], float(fit.values[0])).rms,
        warnings=tuple(warnings),
        viscous=float(constant.values[1]),
        viscous_std=float(constant.std[1]),
        speed=speed,
        torque=torque,
        parts={"coulomb": fit.parts_of(0), "viscous": constant.parts_of(1)},
    )


def score(bags: JointBags, law: LawEntry | None, coulomb: float) -> TorqueScore:
    """Return the error of a friction model on bags.

    Args:
        law: Of the viscous friction; None for the model of the replay.
        coulomb: Its Coulomb torque. [N m]
    """
    whole, weights = bags.gram.sum(axis=0), np.zeros(COLUMNS)
    if law is None:
        weights[MODEL] = 1.0
    else:
        weights[SIGN] = coulomb
        weights[VISCOUS] = viscous_law(law).viscous(NODES_DEGC)
    measured = whole[MEASURED, MEASURED]
    square = weights @ whole @ weights - 2.0 * weights @ whole[:, MEASURED] + measured
    speed = whole[VISCOUS].sum(axis=0)  # products of the velocity
    energy = float(weights @ speed / speed[MEASURED]) - 1.0 if speed[MEASURED] > 0 else np.nan
    square = max(float(square), 0.0)
    return TorqueScore(
        float(np.sqrt(square / max(int(bags.rows.sum()), 1))),
        float(np.sqrt(square / measured)) if measured > 0 else float("nan"),
        energy,
    )


def _merge(bags: JointBags, sensors: SensorLimits, own_bodies: bool, source: str) -> MergedSums:
    robots = len(np.unique(bags.robot))
    group = bags.robot if robots >= MIN_GROUPS else np.arange(len(bags.robot))
    return MergedSums(bags, bags.gram.sum(axis=0), group, sensors, own_bodies, source)


def _fitted(kind: FrictionLaw, merged: MergedSums) -> tuple[LawEntry, Fit]:
    if kind.merged_fit is None:
        raise NotIdentifiableError("it has no fit to the sums of a fleet", "a law with merged_fit")
    return kind.merged_fit(merged)


def _held_out(kind: FrictionLaw, merged: MergedSums, fold: Int) -> HeldOut:
    """Error of a law on bags at temperatures that its fit has not seen."""
    square = total = rows = 0.0
    folds = np.unique(fold)
    for one in folds:
        seen, unseen = merged.bags[fold != one], merged.bags[fold == one]
        law, fit = _fitted(kind, _merge(seen, merged.sensors, merged.own_bodies, ""))
        error = score(unseen, law, float(fit.values[0]))
        count = float(unseen.rows.sum())
        square += error.rms**2 * count
        total += float(unseen.gram[:, MEASURED, MEASURED].sum())
        rows += count
    relative = float(np.sqrt(square / total)) if total > 0 else float("nan")
    return HeldOut(len(folds), float(np.sqrt(square / rows)), relative)


def _require(bags: JointBags) -> None:
    samples = int(bags.rows.sum())
    if samples < MIN_SAMPLES or len(bags.rows) < 2:
        raise NotIdentifiableError(
            f"{bags.name} moves in {samples} samples of {len(bags.rows)} bags",
            f"at least {MIN_SAMPLES} in two bags",
            "record motions of this joint at several speeds and in both directions",
        )
    whole = bags.gram.sum(axis=0)
    square = float(whole[VISCOUS, VISCOUS].sum())
    along = float(whole[SIGN, VISCOUS].sum()) ** 2 / max(float(whole[SIGN, SIGN]), 1e-300)
    if not square - along > MIN_INDEPENDENT * square:
        raise NotIdentifiableError(
            f"{bags.name} moves at one speed: Coulomb and viscous friction cannot be separated",
            "speeds that differ by a factor of 1.5 or more",
            "record slow and fast motions in both directions",
        )


HELD_OUT = 0.2  # share of the bags, the newest, that test the fit of the others
DIFFERENT = ("wear", "friction", "payload")  # findings whose robots are left out
MIN_BAGS = 10  # that test


def identify_fleet(
    tables: FleetTables, model: RobotModel, dataset: str, sensors: SensorLimits = DEFAULT_LIMITS
) -> tuple[FleetFriction, RobotModel]:
    """Identify the friction of all joints from the merged sums of all bags.

    Robots whose friction or payload differs from that of their sisters, or has changed, are left
    out. A test on the newest bags comes first; the model is then that of all bags.

    Returns:
        What was found, and the model with it.
    """
    read = tables.runs.filter(pl.col("reason") == "")
    own = tables.of_model(model.model_id)
    if own.runs.is_empty():
        found = ", ".join(sorted(read["model_id"].unique().to_list())) or "no bag"
        raise NotIdentifiableError(
            f"the dataset was made with model {found}, not with {model.model_id}",
            "the model file that the bags were run with",
            "name that file, or run the bags again",
        )
    robots = sorted(own.runs["robot"].unique().to_list())
    bags = bag_joints(own, robots)
    findings = compare(own, bags, duty_of(own.hours, robots)).findings
    left_out = sorted({one.robot for one in findings if one.kind in DIFFERENT})
    kept = np.array([bags.robots[number] not in left_out for number in bags.robot])
    span = f"{int(kept.sum())} bags of {len(robots) - len(left_out)} robots"
    source, bodies = f"fleet: {span}", bodies_identified(model)
    fits: list[FrictionFit] = []
    refused: list[str] = []
    held: list[FleetTorqueScore] = []
    for place, name in enumerate(bags.joints):
        gram, rows = sums_of_joint(own, bags, name)
        used = kept & (rows > 0)
        degc = bags.degc[used, place]
        if np.isfinite(degc).any():  # of the others the sums are at the fallback
            degc = np.where(np.isnan(degc), model.temperature.fallback_degc, degc)
        joint = JointBags(
            name, without_nuisances(gram[used]), rows[used], degc,
            bags.robot[used], bags.stamp_ns[used],
        )  # fmt: skip
        try:
            fits.append(fit_merged(joint, sensors.std, bodies, source))
            held += _newest_held_out(joint, sensors.std, bodies)
        except NotIdentifiableError as error:
            refused.append(str(error))
    if not fits:
        raise NotIdentifiableError(
            "; ".join(refused) or "no bag of the dataset has measured torque",
            "at least one joint that moves, with measured torque",
            "run the bags with --effort",
        )
    fits, implausible = check_friction(fits)
    refused += implausible
    written = with_friction(model, fits, source)
    done = f"Friction identified from {span}."
    provenance = identified_from(model.provenance, done, [f"dataset {dataset}: {span}"])
    found = FleetFriction(
        dataset,
        int(kept.sum()),
        len(robots) - len(left_out),
        tuple(fits),
        tuple(refused),
        tuple(held),
        tuple(left_out),
    )
    return found, written.changed(provenance=provenance)


def _newest_held_out(
    bags: JointBags, sensors: SensorLimits, bodies: bool
) -> list[FleetTorqueScore]:
    """Error on the newest bags of a fit that has not seen them; empty where they are few."""
    order = np.argsort(bags.stamp_ns, kind="stable")
    count = int(HELD_OUT * len(order))
    if count < MIN_BAGS:
        return []
    seen, unseen = bags[order[:-count]], bags[order[-count:]]
    fit = fit_merged(seen, sensors, bodies, "")
    after: TorqueScore = score(unseen, fit.law, fit.coulomb)
    before = score(unseen, None, 0.0)
    return [
        FleetTorqueScore(bags.name, after.rms, before.rms, after.energy_error, before.energy_error)
    ]
