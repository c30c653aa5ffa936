"""Sections of the page on paper A that stand for themselves: power, friction, effects, plant."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from robot_energy.bag_replay import replay
from robot_energy.blocks import Float
from robot_energy.physics.friction import with_fixed_friction
from robot_energy.report.document import Document
from robot_energy.report.formats import percent
from robot_energy.report.friction_figure import friction_over_temperature
from robot_energy.report.identification import friction_tables, losses_section
from robot_energy.report.power_figure import power_and_energy
from robot_energy.report.series import Series, compared_series
from robot_energy.results.identification import FrictionReport
from robot_energy_papers.effects import ALL, EFFECTS, NO_OIL, NOTHING
from robot_energy_papers.models import FOLLOWS
from robot_energy_papers.paper_a import PaperA, mean_shaft_power
from robot_energy_papers.paper_a_figures import (
    POWER_DEGC,
    REFERENCE_DEGC,
    figures,
    friction_errors,
    nearest_row,
)
from robot_energy_papers.temperature_figures import shaft_power_over_temperature

RIG = "virtual rig, KR 16 class"
WINDOW = 7.0  # s of fig. 5
SMOOTH = 0.02  # s


def power_section(document: Document, result: PaperA) -> None:
    """Write power over time: fig. 1, 4 and 5.

    Args:
        document: The page.
        result: The study.
    """
    document.heading("Power over time (fig. 1, 4 and 5)")
    model = result.identified.models[FOLLOWS]
    rest = _series(result.rest.path, result)
    document.figure(
        lambda path: power_and_energy(rest, path, f"Fig. 1, rest in several poses, {RIG}"),
        "Counterpart of fig. 1: HOLD between motions, and the power that remains while the drives "
        "feed back (P_gen), the loss of the grid side. From the recording that identified the "
        "constant losses.",
    )
    index = nearest_row(result, POWER_DEGC)
    row = result.rows[index]
    warm = _series(result.test[index].path, result)
    document.figure(
        lambda path: power_and_energy(
            warm, path, f"Fig. 4, robot at {row.robot_degc:.0f} degC, {RIG}"
        ),
        f"Counterpart of fig. 4: measured and predicted power and energy at "
        f"{row.robot_degc:.0f} degC, held out; energy error {percent(row.error(FOLLOWS), True)}. "
        "The dashed curve is the same model with friction held at 22 degC.",
    )
    curves = {
        f"robot {curve.robot_degc:.0f}, motor {curve.motor_degc:.0f} degC": _window(
            curve.time, curve.power, result
        )
        for curve in result.shaft
    }
    document.figure(
        lambda path: shaft_power_over_temperature(
            curves, path, model.joint_names[0], f"Fig. 5, {RIG}"
        ),
        "Counterpart of fig. 5: measured shaft power of axis 1 in the same motions, traced torque "
        "times speed. Warm oil takes less power while driving and leaves more while braking.",
    )
    document.table(
        "Mean shaft power of axis 1 over the whole set, traced",
        ("robot", "motor of axis 1", "mean shaft power"),
        [
            (
                f"{curve.robot_degc:.1f} degC",
                f"{curve.motor_degc:.1f} degC",
                f"{mean_shaft_power(curve):.0f} W",
            )
            for curve in result.shaft
        ],
    )


def _series(bag: Path, result: PaperA) -> list[Series]:
    """Measured, predicted, and predicted with friction held at 22 degC."""
    model = result.identified.models[FOLLOWS]
    found = compared_series(replay(bag, model, keep_curves=True), "predicted, friction follows")
    held = compared_series(
        replay(bag, with_fixed_friction(model, REFERENCE_DEGC), keep_curves=True),
        f"predicted, friction held at {REFERENCE_DEGC:g} degC",
        "fixed",
    )
    if found is None or held is None:  # held_out has refused such a bag before
        return []
    return [*found, held[1]]


def _window(time: Float, power: Float, result: PaperA) -> tuple[Float, Float]:
    """The seconds in which axis 1 works hardest in the coldest set, smoothed a little."""
    first = result.shaft[0]
    length = round(WINDOW / float(np.median(np.diff(first.time))))
    work = np.convolve(np.abs(first.power), np.ones(length), "valid")
    begin = float(first.time[int(np.argmax(work))])
    count = max(round(SMOOTH / float(np.median(np.diff(time)))), 1)
    mean = np.convolve(power, np.ones(count) / count, "same")
    rows = (time >= begin) & (time <= begin + WINDOW)
    return time[rows], mean[rows]


def friction_section(document: Document, result: PaperA) -> None:
    """Write the identification: fig. 6.

    Args:
        document: The page.
        result: The study.
    """
    found = result.identified
    document.heading("Identification (fig. 6)")
    document.paragraph(
        "The start is a model with bodies and gears of the class and no friction at all, and "
        "100 W guessed for each constant loss. Friction comes from the traced torque less the "
        "rigid-body torque (eq. 8 to 10), the constant losses from rest and hard braking "
        "(eq. 1). Bodies, gears and payload are those of the rig: the paper too takes the "
        "maker's model for known."
    )
    document.figure(
        lambda path: friction_over_temperature(found.fits, path, title=f"Fig. 6, {RIG}"),
        "Counterpart of fig. 6: viscous friction of all axes over motor temperature, motor side. "
        "The points are free; the laws compete on temperatures that their fit has not seen.",
    )
    friction_tables(FrictionReport("motor_torque", tuple(found.fits), ()), document)
    errors = friction_errors(result)
    picks = sorted({0, len(errors) // 2, len(errors) - 1})
    names = [fit.name for fit in found.fits]
    document.table(
        "Identified over true viscous friction less 1, at the motor temperatures of one set",
        ("set", *names),
        [
            (
                f"robot at {errors[index][0].mean():.0f} degC",
                *(percent(value, True) for value in errors[index][1].tolist()),
            )
            for index in picks
        ],
    )
    document.paragraph(
        "The truth is the rig's lubricant at gear temperature and the eddy drag of the motor. The "
        "table answers what the paper could not know: load-dependent and Stribeck friction, weaker "
        "magnets that make torque read too high, and an exponential where the oil follows "
        "Walther's law are inside the identified figures. Where they compensate, the energy is "
        "better than the parameters."
    )
    losses_section(found.cabinet, document)


def effects_section(document: Document, result: PaperA) -> None:
    """Write what each unmodelled effect costs.

    Args:
        document: The page.
        result: The study.
    """
    document.heading("What each unmodelled effect costs")
    degc = result.scale.rigs.test_degc
    rows = {row.name: row for row in result.effects}
    document.paragraph(
        "The whole experiment again, identification included, on rigs with other effects; soaked "
        "at their temperatures. Plain model of the paper, held-out sets. \u201cWithout\u201d: all "
        "effects but this one; \u201conly\u201d: this one alone beside rigid bodies, Coulomb "
        "friction and oil. Copper brings the rise of its resistance with it where it is left out; "
        "the rise is shown only together with copper."
    )
    shown = [name for name in (ALL, NOTHING, NO_OIL) if name in rows]
    shown += [f"without {name}" for name in EFFECTS if f"without {name}" in rows]
    shown += [f"only {name}" for name in EFFECTS if f"only {name}" in rows]
    document.table(
        "Error of grid energy, friction follows temperature",
        ("rig", *(f"{value:.0f} degC" for value in degc), "mean", "cost"),
        [
            (
                name.replace("_", " "),
                *(percent(value, True) for value in rows[name].follows),
                percent(rows[name].mean, True),
                _cost(name, rows[ALL].mean, rows[NOTHING].mean, rows[name].mean),
            )
            for name in shown
        ],
    )
    document.paragraph(
        "Cost: what the effect adds to the mean error, in company (all effects less without it) "
        "or alone (only it less none). Where friction is concerned, identification absorbs most of "
        "it; what happens behind the shaft it cannot see."
    )
    no_oil = rows[NO_OIL]
    document.paragraph(
        "Control: with the oil held at one temperature nothing may be gained. There the model with "
        f"friction identified cold is off by {percent(max(no_oil.fixed, key=abs), True)} at "
        f"worst, the one that follows temperature by {percent(no_oil.worst, True)}; with all "
        f"effects it is {percent(max(rows[ALL].fixed, key=abs), True)} against "
        f"{percent(rows[ALL].worst, True)}."
    )


def _cost(name: str, everything: float, nothing: float, mean: float) -> str:
    if name.startswith("without"):
        return percent(everything - mean, True)
    return percent(mean - nothing, True) if name.startswith("only") else "-"


def plant_section(document: Document, result: PaperA) -> None:
    """Write what plant the rig plays.

    Args:
        document: The page.
        result: The study.
    """
    document.heading("The plant behind these figures")
    found, data = result.calibration, figures(result)["calibration"]
    document.paragraph(
        "Kinematics, speeds, limits and test weight are published; bodies and accelerations are "
        "those of the sister robot; gear ratios, rotors, friction, motors, thermal figures and "
        "constant losses are assumed. The rig shares rigid bodies and gears with the model and "
        "nothing else. Truth of the rig:"
    )
    low, high = data["energy_20_over_60"]
    document.table(
        "Calibration",
        ("figure", "virtual rig", "paper A, or what its text allows"),
        [
            (
                "E(20 degC) / E(60 degC)",
                f"{low:.2f} to {high:.2f}",
                "E(22 degC) / E(hot) of 1.4 to 1.8, from 45 % read either way",
            ),
            (
                "peak grid power",
                f"{data['peak_power_at_60'][0] / 1e3:.1f} to "
                f"{data['peak_power_at_60'][1] / 1e3:.1f} kW",
                "approx. 8 kW",
            ),
            (
                "HOLD power",
                f"{found.holding.mean:.0f} W, {found.holding.least:.0f} to "
                f"{found.holding.greatest:.0f} W over {found.holding.poses} poses",
                "not given; below about 800 W if 0.01 is meant as a ratio",
            ),
            ("HOLD deviation over poses", percent(found.holding.deviation), "approx. 10 %"),
        ],
    )
    flows = ("friction_power", "iron_loss", "copper_loss", "inverter_loss", "rectifier_loss",
             "brake_power", "loss_dc", "loss_grid")  # fmt: skip
    document.table(
        "Where the energy goes, mean power of one set in a soaked rig [W]",
        ("flow", *(f"{degc:.0f} degC" for degc in found.flows)),
        [
            (
                name.replace("_", " "),
                *(f"{flow[name]:.0f}" for flow in found.flows.values()),
            )
            for name in flows
        ],
        ("grid power", *(f"{flow['grid_power']:.0f}" for flow in found.flows.values())),
    )
