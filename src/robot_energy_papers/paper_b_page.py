"""The studies of paper B as JSON, what its templates name, and the front picture."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robot_energy.model import load
from robot_energy.physics.rigid_body import Robot
from robot_energy.results.base import json_value
from robot_energy.timeline.blocks import Float
from robot_energy_identify.drives.drives import Way
from robot_energy_papers.drawings import (
    GREY,
    FigureLine,
    bars,
    by_column,
    over_time,
    stacked,
)
from robot_energy_papers.drive_study import PAPER, WAY_NAMES, DriveTest
from robot_energy_papers.machines import ARM, MACHINES, PARTS, Energies
from robot_energy_papers.pages import Piece, hundred
from robot_energy_papers.paper_b import (
    BOTH,
    DEFINITIONS,
    SLOWED,
    VALIDATION,
    WALL,
    WALL_HELD,
    PaperB,
)
from robot_energy_report.canvas import COLOURS, SERIES
from robot_energy_report.drives import efficiency_maps
from robot_energy_report.formats import NOTHING

PAPER_JOINTS, PAPER_TOTAL = (0.868, 0.855, 0.935), 0.837  # accuracies, paper B
RIG = "virtual rig, Printing Mantis class"
MEASURED, OURS, OTHER = COLOURS["measured"], COLOURS["predicted"], COLOURS["fixed"]
SHOWN: dict[Way, str] = {
    "none": "none",
    "constant": "87.5 %",
    "constant_fitted": "constant",
    "written": "maps as written",
    "map": "our maps",
    "map_processed": "our maps, 2nd",
    "losses": "loss model",
    "loss_map": "loss map",
}
DRAWN: dict[Way, str] = {"none": GREY, "written": OTHER, "losses": OURS}
SMOOTH = 0.2  # s, of powers and efficiencies over time
POINTS = 500  # of the path of the tool
MIN_POWER = 0.5  # W, below which an efficiency is not drawn
MACHINE_POWERS = {
    "net": "mechanical, net over the joints",
    "positive": "mechanical, joints that drive",
    "electrical": "electrical, drives",
}
MIN_SHAFT_SHARE = 0.01  # of the shafts' energy; below it a drive has no accuracy of its own
QUARTILES = (0.0, 0.25, 0.5, 0.75, 1.0)
MARKS = {  # of the stacked bars: of the models' layer, or of the rigs'
    "mechanical, net": ("layer", "mechanical, net"),
    "mechanical, magnitude": ("layer", "mechanical, magnitude"),
    "electrical on the rig": ("rig", "electrical, drives"),
}


def front_picture(result: PaperB, path: Path) -> None:
    """Draw where the electrical energy of one layer goes."""
    title = "One printed layer, models of machine classes"
    unit = "electrical energy of the drives [J]"
    stacked(_machine_names(), _parts(result), {}, unit, path, title)


def below_every_joint(result: PaperB) -> list[str]:
    """Return the runs and definitions whose total accuracy lies below that of every joint."""
    found: list[str] = []
    for run in (VALIDATION, WALL):
        for name, value in result.main.mechanical[run].accuracy.items():
            for total, what in ((value.total, "sum of energies"), (value.summed, "summed power")):
                if total < float(value.joint.min()) - 5e-4:
                    found.append(f"{run}, {name}, {what}")
    return found


def context(result: PaperB) -> dict[str, Any]:
    """Return what the expressions of the templates use."""
    return {
        "result": result,
        "distributions": {run: distributions(found) for run, found in result.plants.items()},
        "paper": {
            "joints": PAPER_JOINTS,
            "total": PAPER_TOTAL,
            "mean": float(np.mean(PAPER_JOINTS)),
            "ways": PAPER,
        },
        "paper_ways": [hundred(PAPER[way]) if way in PAPER else NOTHING for way in SHOWN],
        "short": SHOWN,
        "way_names": WAY_NAMES,
        "test": result.main.tests[WALL],
        "held": result.main.tests[WALL_HELD],
        "beyond": result.trained[SLOWED].tests[VALIDATION],
        "definitions": DEFINITIONS,
        "below_every_joint": below_every_joint(result),
        "machines": MACHINES,
        "energy_parts": PARTS,
        "relative": {stage: result.relative(stage) for stage in ("wall", "layer", "rig")},
        "wall_name": _wall_name(result),
    }


def _wall_name(result: PaperB) -> str:
    layers = result.scale.layers
    return f"{layers} layers" if layers else f"layers at {len(result.scale.heights)} heights"


def _machine_names() -> list[str]:
    return [machine.name for machine in MACHINES.values()]


def _parts(result: PaperB) -> dict[str, list[float]]:
    """Electrical energy of one layer, by part and machine. [J]"""
    return {
        text: [found.layer.parts[part] for found in result.machines.values()]
        for part, text in PARTS.items()
    }


def pieces(result: PaperB) -> dict[str, Piece]:
    """Return the figures of the page."""
    return {**_drive_figures(result), **_machine_figures(result)}


def _drive_figures(result: PaperB) -> dict[str, Piece]:
    names = result.main.model.joint_names
    check = result.main.mechanical[VALIDATION].run
    test, held = result.main.tests[WALL], result.main.tests[WALL_HELD]
    mechanical = [
        FigureLine("measured", check.time, _with_sum(check.shaft_measured), MEASURED, 2.4),
        FigureLine("predicted", check.time, _with_sum(check.shaft_predicted), OURS, 0.8),
    ]
    position = check.recording.torque.joint_position[check.rows]
    energy = {
        name: (check.duration @ _with_sum(power)).tolist()
        for name, power in (
            ("measured", check.shaft_measured),
            ("predicted", check.shaft_predicted),
        )
    }
    powers = [("measured", test.measured, MEASURED, 2.4)]
    powers += [(WAY_NAMES[way], test.ways[way].power, c, 1.0) for way, c in DRAWN.items()]
    electrical = [
        FigureLine(label, test.time, _with_sum(_smoothed(power, test.time)), colour, width)
        for label, power, colour, width in powers
    ]
    efficiency = [
        FigureLine(run, found.time, _efficiency(found), colour)
        for run, found, colour in ((WALL, test, OURS), (WALL_HELD, held, OTHER))
    ]
    top = 1.8 * float(np.quantile(test.measured.sum(axis=1), 0.9))
    accuracy = {
        run: [100 * result.main.tests[run].ways[way].accuracy for way in SHOWN]
        for run in (WALL, WALL_HELD, VALIDATION)
    }
    paper = [100 * PAPER[way] if way in PAPER else None for way in SHOWN]
    joints, drives = [*names, "all joints"], [*names, "all drives"]
    return {
        "excitation": lambda path: over_time(
            by_column(names, [FigureLine("joint position", check.time, position, OURS)]),
            "position [rad]", path, RIG,
        ),
        "energies": lambda path: bars(joints, energy, "mechanical energy [J]", path, RIG),
        "validation": lambda path: over_time(
            by_column(joints, mechanical), "power [W]", path, RIG
        ),
        "drives": lambda path: over_time(
            by_column(drives, electrical), "input [W]", path, RIG, limits=(-0.1 * top, top)
        ),
        "accuracy": lambda path: bars(
            [WAY_NAMES[way] for way in SHOWN], accuracy, "energy accuracy [%]", path,
            f"{RIG}, identified at {BOTH}", paper,
        ),
        "efficiency": lambda path: over_time(
            by_column(drives, efficiency), "efficiency [-]", path, RIG, limits=(-0.1, 1.0)
        ),
        "maps": lambda path: efficiency_maps(result.main.drives.fit.axes, path, f"{RIG}, {BOTH}"),
    }  # fmt: skip


def _machine_figures(result: PaperB) -> dict[str, Piece]:
    machines = result.machines
    marks = {
        text: [getattr(found, stage).figures[name] for found in machines.values()]
        for text, (stage, name) in MARKS.items()
    }
    others = result.relative("wall")
    savings = {
        name: [100 * other[name] for other in others.values()]
        for name in next(iter(others.values()))
    }
    paper = [100 * float(MACHINES[key].paper or 0.0) for key in others]
    colours = dict(zip(machines, SERIES, strict=False))
    powers = {
        text: [
            FigureLine(
                MACHINES[key].name, found.curve.time, getattr(found.curve, name), colours[key]
            )
            for key, found in machines.items()
        ]
        for name, text in MACHINE_POWERS.items()
    }
    positions = {
        MACHINES[key].name: [
            FigureLine(f"joint {joint + 1}", found.curve.time, way - way[0], SERIES[joint])
            for joint, way in enumerate(found.curve.joint_position.T)
        ]
        for key, found in machines.items()
    }
    return {
        "path": lambda path: over_time(
            {"tool, less its mean": _tool_path(result)}, "position [m]", path, "models", columns=1
        ),
        "parts": lambda path: stacked(
            _machine_names(), _parts(result), marks, "energy of one layer [J]", path, "models"
        ),
        "relative": lambda path: bars(
            [MACHINES[key].name for key in others], savings, "energy compared with the arm [%]",
            path, f"models, {_wall_name(result)}", paper,
        ),
        "powers": lambda path: over_time(
            powers, "power [W]", path, "models", columns=1, cut=True
        ),
        "positions": lambda path: over_time(positions, "from start [rad, m]", path),
        "heights": lambda path: over_time(
            _over_height(result), "[rad]", path, "model of the arm", along="height of the layer [m]"
        ),
    }  # fmt: skip


def _over_height(result: PaperB) -> dict[str, list[FigureLine]]:
    """Configuration of the arm at the heights of the scale."""
    ranges = np.stack(result.machines[ARM].joint_ranges)  # (heights, 2, joints)
    middle, height = ranges.mean(axis=1), np.array(result.scale.heights)
    joints = [f"joint {joint + 1}" for joint in range(ranges.shape[2])]
    return {
        name: [
            FigureLine(joint, height, column, colour)
            for joint, column, colour in zip(joints, values.T, SERIES, strict=False)
        ]
        for name, values in (
            ("middle of the joint's range in a layer, from the bottom", middle - middle[0]),
            ("way of the joint within a layer", np.ptp(ranges, axis=1)),
        )
    }


def _tool_path(result: PaperB) -> list[FigureLine]:
    """Position of the arm's tool in the base frame during one layer. [m]"""
    machine, curve = MACHINES[ARM], result.machines[ARM].curve
    robot = Robot.from_model(load(machine.model))
    rows = slice(None, None, max(1, len(curve.time) // POINTS))
    place = np.array([robot.link_position(q, machine.link) for q in curve.joint_position[rows]])
    place -= place.mean(axis=0)
    return [
        FigureLine(axis, curve.time[rows], values, colour)
        for axis, values, colour in zip("xyz", place.T, SERIES, strict=False)
    ]


def _with_sum(power: Float) -> Float:
    """Columns of the joints and their sum, shape (N, n + 1)."""
    return np.column_stack([power, power.sum(axis=1)])


def _efficiency(test: DriveTest) -> Float:
    """Measured efficiency of each drive and of all, smoothed, shape (N, n + 1). [-]"""
    shaft = _smoothed(_with_sum(test.shaft), test.time)
    given = _smoothed(_with_sum(test.measured), test.time)
    drawn = (given > MIN_POWER) & np.append(moving(test), True)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(drawn, shaft / given, np.nan)


def _smoothed(values: Float, time: Float) -> Float:
    """Means over `SMOOTH` of every column, shape (N, K)."""
    window = np.ones(round(SMOOTH / float(np.median(np.diff(time)))))
    weight = np.convolve(np.ones(len(values)), window, mode="same")
    columns = [np.convolve(column, window, mode="same") / weight for column in values.T]
    return np.stack(columns, axis=1)


def figures(result: PaperB) -> dict[str, Any]:
    """Return everything that was found, JSON-ready. Units: J, W, s, shares of 1."""
    return {
        "about": "virtual rig and models of machine classes: nothing was measured on a robot",
        "seed": result.seed,
        "quick": result.quick,
        "layers_simulated": result.scale.layers,
        "heights": list(result.scale.heights),
        "weighted_fit_on_validation": json_value(result.weighted),
        "trained": {
            name: {
                "mechanical": {
                    run: json_value(test.accuracy) for run, test in found.mechanical.items()
                },
                "drives": {run: _test(test) for run, test in found.tests.items()},
            }
            for name, found in result.trained.items()
        },
        "plants": {
            run: {str(seed): _test(test) for seed, test in plants.items()}
            for run, plants in result.plants.items()
        },
        "distributions": {run: distributions(found) for run, found in result.plants.items()},
        "machines": {
            key: {
                "layer": _energies(found.layer),
                "wall": _energies(found.wall),
                "rig_layer": _energies(found.rig),
                "electrical_at_heights": found.at_heights,
                "joint_ranges_at_heights": [one.tolist() for one in found.joint_ranges],
                "paper_relative_to_arm": MACHINES[key].paper,
            }
            for key, found in result.machines.items()
        },
        "sensitivity": json_value({"gantry_over_arm": result.gantry, "map_accuracy": result.maps}),
        "relative_to_arm": {stage: result.relative(stage) for stage in ("layer", "wall", "rig")},
    }


def moving(test: DriveTest) -> NDArray[np.bool_]:
    """Return which drives move enough in a run for an accuracy of their own, shape (n,)."""
    shaft = np.abs(test.joint_efficiency * test.energy)
    return np.asarray(shaft > MIN_SHAFT_SHARE * shaft.sum())


def _test(test: DriveTest) -> dict[str, Any]:
    """Figures of a run; no accuracy of a drive that hardly moves in it."""
    found = json_value(test)
    for way in found["ways"].values():
        pairs = zip(way["joint"], moving(test).tolist(), strict=True)
        way["joint"] = [value if known else None for value, known in pairs]
    return found


def _energies(found: Energies) -> dict[str, Any]:
    return {**json_value(found), **found.figures}


def distributions(plants: Mapping[int, DriveTest]) -> dict[Way, dict[str, list[float]]]:
    """Return least value, quartiles and greatest value over plants, by way.

    Returns:
        Of ``accuracy`` [-] and ``rms`` [W].
    """
    return {
        way: {
            key: np.quantile(
                [getattr(test.ways[way], key) for test in plants.values()], QUARTILES
            ).tolist()
            for key in ("accuracy", "rms")
        }
        for way in WAY_NAMES
    }
