"""The section of the three machines of paper B."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from robot_energy.blocks import Float
from robot_energy.report.canvas import SERIES
from robot_energy.report.document import Document
from robot_energy.report.formats import percent
from robot_energy_papers.machine_figures import (
    FigureLine,
    bars,
    joint_panels,
    powers_over_time,
    stacked,
)
from robot_energy_papers.machines import ARM, MACHINES, PARTS
from robot_energy_papers.paper_b import PaperB, at_heights, relative


def print_machines(result: PaperB, page: Document) -> None:
    """Energy of the machines for one layer, and beside the arm's."""
    layers = [found.layer for found in result.machines.values()]
    measures = tuple(layers[0].figures)
    rows = [(name, *(f"{layer.figures[name]:.0f}" for layer in layers)) for name in measures]
    rows += [
        (f"- {text}", *(f"{layer.parts[part]:.0f}" for layer in layers))
        for part, text in PARTS.items()
    ]
    rows.append(("cabinet, constant, not compared", *(f"{e.cabinet:.0f}" for e in layers)))
    names = [MACHINES[key].name for key in result.machines]
    page.table("Energy of one layer, models [J]", ("", *names), rows)
    others = [key for key in result.machines if key != ARM]
    beside = [("paper B, wall", *(percent(MACHINES[key].paper, True) for key in others))]
    stages = {"wall": _wall_name(result), "layer": "one layer", "rig": "one layer, rigs"}
    for stage, name in stages.items():
        found = relative(result, stage)
        beside += [
            (f"{measure}, {name}", *(percent(found[key][measure], True) for key in others))
            for measure in measures
        ]
    page.table("Energy beside the arm's", ("", *(MACHINES[key].name for key in others)), beside)


def add_machines(document: Document, result: PaperB) -> None:
    """Add the section of the three machines."""
    document.heading("Three machines, one wall")
    arm = result.machines[ARM].layer
    gantry = result.machines["testbed"].layer
    rest = float(gantry.electrical.sum()) - gantry.parts["holding"]
    braked = rest / float(arm.electrical.sum()) - 1.0
    document.paragraph(
        "Each machine prints the outline of 1.2 m by 0.3 m at 125 mm/s; " + _wall_text(result) + " "
        "Shipped models of the class predict; the same layer is played on virtual rigs with "
        "friction and losses of their own, as a second opinion."
    )
    print_machines(result, document)
    document.paragraph(
        "What the comparison shows depends on what is counted. Net mechanical energy of a closed "
        f"layer is friction alone, since what one joint lifts another lowers: the arm's is "
        f"{arm.net.sum():.0f} J, less than the gantry's {gantry.net.sum():.0f} J. While it moves "
        f"sideways at constant height, joint 2 of the arm drives and joint 3 brakes: the magnitude "
        f"of its joint power is {arm.absolute.sum():.0f} J. Only by that measure, and in "
        "electrical energy, do the planar arm's 92 to 93 % of the paper come out. The gantry saves "
        "less here than the 77 % of the paper: its friction is assumed, 300 N along the hall."
    )
    saved = relative(result, "layer")["testbed"]["electrical, drives"]
    holding = arm.parts["holding"] / float(arm.electrical.sum())
    document.paragraph(
        "The reason given in the paper, weight, is right, and it works through the windings: "
        f"{percent(holding)} of the arm's electrical energy heats them to hold the arm up, moving "
        "or not. The gantry's motor holds its ram; a brake would save "
        f"{gantry.parts['holding']:.0f} J a layer and take the gantry from "
        f"{percent(saved, True)} to {percent(braked, True)}. "
        "Constant losses of the cabinets are left out, as in the paper; over a layer they exceed "
        "those of every drive, so a monitor must not leave them out."
    )
    heights = [f"{value:.0f} J at {height:g} m" for value, height in zip(
        at_heights(result, ARM), result.scale.heights, strict=True)]  # fmt: skip
    document.paragraph(
        "Height matters for the arm alone, by a few per cent: one layer takes "
        + ", ".join(heights)
        + "."
    )
    names = [machine.name for machine in MACHINES.values()]
    parts = {
        text: [found.layer.parts[part] for found in result.machines.values()]
        for part, text in PARTS.items()
    }
    marks = {
        "mechanical, net": [f.layer.figures["mechanical, net"] for f in result.machines.values()],
        "mechanical, magnitude": [
            f.layer.figures["mechanical, magnitude"] for f in result.machines.values()
        ],
        "electrical on the rig": [
            f.rig.figures["electrical, drives"] for f in result.machines.values()
        ],
    }
    document.figure(
        lambda path: stacked(names, parts, marks, "energy of one layer [J]", path, "models"),
        "Electrical energy of the drives for one layer and where it goes; mechanical beside.",
    )
    others = relative(result, "wall")
    measures = tuple(next(iter(others.values())))
    document.figure(
        lambda path: bars(
            [MACHINES[key].name for key in others],
            {name: [100 * others[key][name] for key in others] for name in measures},
            "energy beside the arm's [%]",
            path,
            f"models, {_wall_name(result)}",
            [100 * float(MACHINES[key].paper or 0.0) for key in others],
        ),
        "Energy of the wall beside the arm's, by what is counted (as fig. 18).",
    )
    curves = {key: found.curve for key, found in result.machines.items()}
    document.figure(
        lambda path: powers_over_time(
            {
                what: [
                    FigureLine(
                        MACHINES[key].name, curve.time, getattr(curve, name)[:, None], SERIES[k]
                    )
                    for k, (key, curve) in enumerate(curves.items())
                ]
                for name, what in (
                    ("net", "mechanical, net over the joints"),
                    ("positive", "mechanical, joints that drive"),
                    ("electrical", "electrical, drives"),
                )
            },
            "power [W]",
            path,
            "models",
        ),
        "Power while one layer is printed (as fig. 17); peaks in the corners are cut off.",
    )
    time = curves["mantis_held"].time
    document.figure(
        lambda path: joint_panels(
            [
                FigureLine(f"joint {joint + 1}", time, _ways(result, joint), SERIES[joint])
                for joint in range(6)
            ],
            names,
            "from start [rad, m]",
            path,
        ),
        "Joint positions while one layer is printed, from their start (as fig. 11).",
    )


def front_picture(result: PaperB, path: Path) -> None:
    """Draw where the electrical energy of one layer goes."""
    parts = {
        text: [found.layer.parts[part] for found in result.machines.values()]
        for part, text in PARTS.items()
    }
    names = [machine.name for machine in MACHINES.values()]
    title = "One printed layer, models of machine classes"
    stacked(names, parts, {}, "electrical energy of the drives [J]", path, title)


def _ways(result: PaperB, joint: int) -> Float:
    """Way of one joint from its start, a column per machine; nan where there is no such joint."""
    columns: list[Float] = []
    for found in result.machines.values():
        position = found.curve.joint_position
        has = joint < position.shape[1]
        columns.append(
            position[:, joint] - position[0, joint] if has else np.full(len(position), np.nan)
        )
    return np.stack(columns, axis=1)


def _wall_name(result: PaperB) -> str:
    layers = result.scale.layers
    return f"{layers} layers" if layers else f"layers at {len(result.scale.heights)} heights"


def _wall_text(result: PaperB) -> str:
    if result.scale.layers:
        return f"all {result.scale.layers} layers of the wall of 1 m are simulated one by one."
    heights = ", ".join(f"{height:g}" for height in result.scale.heights)
    return f"of the wall of 1 m, single layers at {heights} m stand for all (short form)."
