"""The studies of paper B as one self-contained page."""

from __future__ import annotations

import numpy as np

from robot_energy.blocks import Float
from robot_energy.report.canvas import COLOURS
from robot_energy.report.document import Document
from robot_energy.report.efficiency_figure import efficiency_maps
from robot_energy.report.formats import NOTHING, percent
from robot_energy_papers.accuracy import DEFINITIONS
from robot_energy_papers.drive_study import PAPER, WAY_NAMES, DriveTest
from robot_energy_papers.machine_figures import GREY, FigureLine, bars, joint_panels, measured_and
from robot_energy_papers.mantis import RATE
from robot_energy_papers.paper_b import BOTH, SLOWED, VALIDATION, WALL, WALL_HELD, PaperB
from robot_energy_papers.paper_b_figures import told
from robot_energy_papers.paper_b_machines_page import add_machines
from robot_energy_papers.paper_b_numbers import (
    COLUMNS,
    PAPER_JOINTS,
    PAPER_TOTAL,
    SLIPS,
    UNKNOWN,
    below_every_joint,
    numbers,
)

PAPER_TITLE = "energy of robots for 3D concrete printing (Robotics 2024, 13(5), 78)"
RIG = "virtual rig, Printing Mantis class"
MEASURED, OURS, OTHER = COLOURS["measured"], COLOURS["predicted"], COLOURS["fixed"]
SHOWN = ("none", "constant", "map", "map_processed", "losses")
WAY_SHORT = {
    "none": "none",
    "constant": "87.5 %",
    "map": "maps",
    "map_processed": "maps, 2nd",
    "losses": "losses",
}
SMOOTH = 0.2  # s, of powers and efficiencies over time
LEAST_POWER = 0.5  # W, below which an efficiency is not drawn


def print_mechanics(result: PaperB, page: Document) -> None:
    """Accuracy of mechanical energy by all definitions."""
    mean = _hundred(float(np.mean(PAPER_JOINTS)))
    rows: list[tuple[str, ...]] = [
        ("paper B, validation", "unknown", *map(_hundred, PAPER_JOINTS), _hundred(PAPER_TOTAL),
         NOTHING, mean),
    ]  # fmt: skip
    for run in (VALIDATION, WALL):
        for name, found in result.main.mechanical[run].accuracy.items():
            rows.append(
                (run, name, *map(_hundred, found.joint.tolist()), _hundred(found.total),
                 _hundred(found.summed), _hundred(found.mean))
            )  # fmt: skip
    columns = ("run", "counted", "joint 1", "joint 2", "joint 3", "total", "summed", "mean")
    page.table("Accuracy of mechanical energy [%]", columns, rows)


def print_drives(result: PaperB, page: Document) -> None:
    """Accuracy of electrical energy by way, run and excitation."""
    columns = ("identified at", "run", *(WAY_SHORT[way] for way in SHOWN))
    accuracy: list[tuple[str, ...]] = [
        ("paper B", "print path",
         *(_hundred(PAPER[way]) if way in PAPER else NOTHING for way in SHOWN), NOTHING),
    ]  # fmt: skip
    rms: list[tuple[str, ...]] = []
    for trained, found in result.trained.items():
        for run, test in found.tests.items():
            ways = [test.ways[way] for way in SHOWN]
            accuracy.append(
                (trained, run, *(_hundred(way.accuracy) for way in ways), _hundred(test.outside))
            )
            rms.append((trained, run, *(f"{way.rms:.1f}" for way in ways)))
    title = "Accuracy of electrical energy, all drives [%]"
    page.table(title, (*columns, "off map"), accuracy)
    page.table("RMS error of the power of a drive [W]", columns, rms)


def page(result: PaperB, command: str) -> Document:
    """Return the whole page.

    Args:
        result: The studies.
        command: That makes it.
    """
    document = Document(
        "Paper B, done again: " + PAPER_TITLE,
        "Every measurement here is one of a virtual rig of the machine's class, every machine a "
        "model of its class. Nothing was measured on a robot: the page proves methods, and shows "
        "where conclusions of the paper stand or depend on what is counted.",
    )
    document.command(command)
    _beside(document, result)
    _mechanics(document, result)
    _drives(document, result)
    add_machines(document, result)
    document.heading("What cannot be known")
    for text in UNKNOWN:
        document.paragraph(text)
    document.heading("Slips in the text, and how they are read here")
    for text in SLIPS:
        document.paragraph(text)
    return document


def _beside(document: Document, result: PaperB) -> None:
    document.heading("Their numbers and ours")
    ways = result.main.tests[WALL].ways
    beyond = result.trained[SLOWED].tests[VALIDATION]
    document.paragraph(
        "The order of the paper holds: electrical energy of a print path comes out at "
        f"{percent(ways['none'].accuracy)} without efficiency and "
        f"{percent(ways['constant'].accuracy)} with a constant one, maps reach "
        f"{percent(ways['map'].accuracy)}. A loss model from the same data reaches "
        f"{percent(ways['losses'].accuracy)} with an RMS error of "
        f"{ways['losses'].rms:.1f} W instead of {ways['map'].rms:.1f} W, and keeps "
        f"{percent(beyond.ways['losses'].accuracy)} where {percent(beyond.outside)} of the samples "
        "lie off the map, where the map's energy is worth nothing "
        f"({percent(beyond.ways['map'].accuracy)})."
    )
    document.table("", COLUMNS, numbers(result))


def _mechanics(document: Document, result: PaperB) -> None:
    names = result.main.model.joint_names
    test = result.main.mechanical[VALIDATION].run
    document.heading("Identified and validated")
    document.paragraph(
        "The virtual Mantis follows an optimised Fourier motion of five harmonics and 20 s, once "
        "at full speed and once at 40 % of it; bodies, rotors and friction follow by ordinary "
        "least squares, as in the paper. Another such motion validates. Measured power is motor "
        "torque as the drive reports it times speed."
    )
    print_mechanics(result, document)
    for name, text in DEFINITIONS.items():
        document.paragraph(f"`{name}`: {text}.")
    lower = below_every_joint(result)
    document.paragraph(
        "The paper's total lies below each of its joints. Here it does so for: "
        + ("; ".join(lower) if lower else "no run and no definition")
        + ". The sum over the joints is what a power meter would see; we use `net`, total of sums, "
        "and read it with `pointwise`, which no cancelling of errors can flatter."
    )
    weighted = result.weighted["net"]
    ordinary = result.main.mechanical[VALIDATION].accuracy["net"]
    document.paragraph(
        f"Weighted least squares, our default, gives {percent(weighted.total)} on the same "
        f"validation run instead of {percent(ordinary.total)}: the method of the fit is not what "
        "limits it, the law of friction is."
    )
    lines = measured_and(
        [
            ("measured", test.shaft_measured, MEASURED, 2.4),
            ("predicted", test.shaft_predicted, OURS, 0.8),
        ],
        test.time,
    )
    document.figure(
        lambda path: joint_panels(lines, [*names, "all joints"], "power [W]", path, RIG),
        "Mechanical power on the validation motion, measured and predicted (as fig. 15).",
    )


def _drives(document: Document, result: PaperB) -> None:
    names = result.main.model.joint_names
    test, held = result.main.tests[WALL], result.main.tests[WALL_HELD]
    document.heading("Electrical energy of the drives")
    document.paragraph(
        "Efficiency maps and the loss model come from the excitation runs, with the power of each "
        "drive measured beside its torque and speed. The print path is the outline of the wall at "
        "125 mm/s; torque is predicted by the identified model. Energy accuracy is "
        "1 - |E - E_measured| / E_measured over all drives."
    )
    print_drives(result, document)
    document.paragraph(
        "Off the map is the share of samples further from every point of a map than it reaches. "
        "At full speed alone the excitation hardly touches print speed; identified slowly and "
        "tested fast, most of the motion is outside. There the nearest point of a map may belong "
        "to rest or braking, and a division by its efficiency can give anything; the loss model "
        "continues its curve. The paper's second stage removes peaks and smooths, which needs the "
        "future and cuts true peaks with false ones."
    )
    shown = ("none", "map_processed", "losses")
    colours = (GREY, OTHER, OURS)
    lines = measured_and(
        [
            ("measured", _smoothed(test.measured), MEASURED, 2.4),
            *(
                (WAY_NAMES[way], _smoothed(test.ways[way].power), colour, 1.0)
                for way, colour in zip(shown, colours, strict=True)
            ),
        ],
        test.time,
    )
    top = 1.8 * float(np.quantile(test.measured.sum(axis=1), 0.9))
    document.figure(
        lambda path: joint_panels(
            lines, [*names, "all drives"], "input [W]", path, RIG, (-0.1 * top, top)
        ),
        "Electrical power of the drives on the print path, all joints moving, means over 0.2 s (as "
        "figs. 19 and 21); peaks in the corners are cut off.",
    )
    groups = [WAY_NAMES[way] for way in SHOWN]
    series = {
        run: [100 * result.main.tests[run].ways[way].accuracy for way in SHOWN]
        for run in (WALL, WALL_HELD, VALIDATION)
    }
    reference = [100 * PAPER[way] if way in PAPER else None for way in SHOWN]
    document.figure(
        lambda path: bars(
            groups, series, "energy accuracy [%]", path, f"{RIG}, identified at {BOTH}", reference
        ),
        "Accuracy of electrical energy by way (as fig. 22).",
    )
    efficiency = [
        FigureLine(run, found.time, _efficiency(found), colour)
        for run, found, colour in ((WALL, test, OURS), (WALL_HELD, held, OTHER))
    ]
    document.figure(
        lambda path: joint_panels(
            efficiency, [*names, "all drives"], "efficiency [-]", path, RIG, (-0.1, 1.0)
        ),
        "Efficiency of the drives on the print path, smoothed over 0.2 s (as fig. 20); it falls "
        "where a joint turns round, because the shaft power does.",
    )
    document.figure(
        lambda path: efficiency_maps(result.main.drives.axes, path, f"{RIG}, {BOTH}"),
        "Reduced efficiency maps (as fig. A1).",
    )


def _efficiency(test: DriveTest) -> Float:
    """Measured efficiency of each drive and of all, smoothed, shape (N, n + 1). [-]"""
    shaft = _smoothed(np.column_stack([test.shaft, test.shaft.sum(axis=1)]))
    given = _smoothed(np.column_stack([test.measured, test.measured.sum(axis=1)]))
    drawn = (given > LEAST_POWER) & np.append(told(test), True)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(drawn, shaft / given, np.nan)


def _smoothed(values: Float) -> Float:
    """Means over `SMOOTH` of every column, shape (N, K)."""
    window = np.ones(round(SMOOTH * RATE))
    weight = np.convolve(np.ones(len(values)), window, mode="same")
    columns = [np.convolve(column, window, mode="same") / weight for column in values.T]
    return np.stack(columns, axis=1)


def _hundred(share: float) -> str:
    return f"{100 * share:.1f}"
