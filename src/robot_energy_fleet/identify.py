"""One friction model from all bags of a fleet."""

from __future__ import annotations

import numpy as np
import polars as pl

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy_fleet.bag_joints import bag_joints, sums_of_joint
from robot_energy_fleet.findings import compare
from robot_energy_fleet.merged_friction import TorqueScore, fit_merged, score
from robot_energy_fleet.merged_laws import JointBags, without_nuisances
from robot_energy_fleet.report import duty_of
from robot_energy_fleet.results.fleet import FleetFriction, FleetTorqueScore
from robot_energy_fleet.tables import FleetTables
from robot_energy_identify.friction.friction import FrictionFit, with_friction
from robot_energy_identify.friction.samples import bodies_identified
from robot_energy_identify.plausibility import check_friction
from robot_energy_identify.provenance import identified_from
from robot_energy_identify.stats.systematic import DEFAULT_LIMITS, SensorLimits

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
        joint = JointBags(
            name, without_nuisances(gram[used]), rows[used], bags.degc[used, place],
            bags.robot[used], bags.stamp_ns[used],
        )  # fmt: skip
        try:
            fits.append(fit_merged(joint, sensors.std, bodies, source))
            held += _held_out(joint, sensors.std, bodies)
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


def _held_out(bags: JointBags, sensors: SensorLimits, bodies: bool) -> list[FleetTorqueScore]:
    """Error on the newest bags of a fit that has not seen them; empty where they are few."""
    order = np.argsort(bags.stamp_ns, kind="stable")
    count = int(HELD_OUT * len(order))
    if count < MIN_BAGS:
        return []
    seen, unseen = bags.only(order[:-count]), bags.only(order[-count:])
    fit = fit_merged(seen, sensors, bodies, "")
    after: TorqueScore = score(unseen, fit.law, fit.coulomb)
    before = score(unseen, None, 0.0)
    return [
        FleetTorqueScore(bags.name, after.rms, before.rms, after.energy_error, before.energy_error)
    ]
