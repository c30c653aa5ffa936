"""What paper B says, number by number, beside what came out here."""

from __future__ import annotations

from robot_energy.blocks import Float
from robot_energy.identify.drives.drives import Way
from robot_energy.report.formats import percent
from robot_energy_papers.drive_study import WAY_NAMES
from robot_energy_papers.machines import MACHINES
from robot_energy_papers.paper_b import VALIDATION, WALL, WALL_HELD, PaperB, relative

Row = tuple[str, str, str, str]
COLUMNS = ("what the text says", "paper B", "here", "how, or why not")
PAPER_JOINTS, PAPER_TOTAL, PAPER_WALL = (0.868, 0.855, 0.935), 0.837, 0.968
PAPER_ENERGY = 691.5  # J

UNKNOWN = (
    "How the machines weigh, rub and lose: link data, gears, motors, the identified parameters "
    "(table 1) and the efficiency maps are not in the text. Ours are of their class, so no joule "
    "can be compared with a joule of the paper, only shares and orders.",
    "What the accuracy of an energy is. Formula 22 is lost; all readings of it are in the tables.",
    "Which of the two configurations the 691.5 J belong to, how the path runs inside the outline, "
    "at which accelerations, and where it lies before each robot. We print the outline at "
    "125 mm/s, corners rounded within 3 mm, 2 m/s^2, all assumed.",
    "What the simulation of the arm calls Total Power, and with which tool. Ours carries a print "
    "head of 20 kg, assumed.",
    "Whether the paper's excitation moved at print speed too. A run at full speed alone learns "
    "little of it: the maps and, less so, the loss model pay for that (see the table).",
)
SLIPS = (
    "A fundamental frequency of 20 Hz with five harmonics: no arm of 620 kg moves at 100 Hz. "
    "A period of 20 s is used here.",
    "The prediction without efficiency is said to be more than half of the measured energy; "
    "38.6 and 43.5 % are less than half. What exceeds one half is the error.",
    "The total accuracy (83.7 %) is below that of every joint (85.5 to 93.5 %). For energies that "
    "are summed and errors of one sign it lies between them; so the total is another quantity, or "
    "errors of different joints do not share their sign.",
    "691.5 J times 0.386 and 0.435 are 267 and 301 J; dividing 267 J by 0.875 gives 305 J. Braking "
    "must have been treated in some way that is not stated, or filtered.",
    "One layer of the Mantis at about 267 J mechanical, 7 to 8 % of the arm's, makes 3.3 to 3.8 kJ "
    "or 140 to 160 W for the arm. A closed path at constant height does no net work against "
    "weight, and friction does not explain that much; the comparison holds for the magnitude of "
    "joint power or for electrical energy, not for net mechanical energy.",
    "Least efficiency where a joint turns round is put down to the drive. It is a property of "
    "the ratio: at zero speed the shaft power is zero whatever the drive does. A loss has no such "
    "pole.",
)


def numbers(result: PaperB) -> list[Row]:
    """Return every number of the text with ours.

    Args:
        result: The studies.
    """
    main = result.main
    accuracy = main.mechanical[VALIDATION].accuracy
    wall, test = main.mechanical[WALL].accuracy, main.tests[WALL]
    held = main.tests[WALL_HELD]
    stage = relative(result, "wall")
    ways = test.ways
    second = ways["map_processed"].accuracy
    rows: list[Row] = [
        (
            "mechanical energy, validation, joints 1 to 3",
            _list(PAPER_JOINTS),
            f"{_list(accuracy['net'].joint)} (net); {_list(accuracy['pointwise'].joint)} "
            "(errors cannot cancel)",
            "ordinary least squares, Coulomb and viscous friction as in the paper; virtual rig",
        ),
        (
            "mechanical energy, validation, total",
            percent(PAPER_TOTAL),
            f"{percent(accuracy['net'].total)} (net); {percent(accuracy['pointwise'].total)} "
            "(errors cannot cancel)",
            "the rig has less that the model does not know than a robot has",
        ),
        (
            "mechanical energy, print path, total",
            percent(PAPER_WALL),
            f"{percent(wall['net'].total)} (net)",
            "better than on the validation run there; here as good",
        ),
        (
            "electrical energy of the print path",
            f"{PAPER_ENERGY} J",
            f"{test.energy.sum():.0f} J all joints, {held.energy.sum():.0f} J joint 1 held",
            "another machine of the class; not tuned",
        ),
        (
            "efficiency of the drives while printing",
            "around 30 to 50 %",
            f"{percent(test.efficiency)} all joints, {percent(held.efficiency)} joint 1 held",
            "winding resistances of the rig were chosen for it: no finding",
        ),
    ]
    unaided: tuple[Way, ...] = ("none", "constant")
    for way, paper in zip(unaided, ("38.6 %", "43.5 %"), strict=True):
        rows.append(
            (
                f"accuracy of electrical energy, {WAY_NAMES[way]}",
                paper,
                percent(ways[way].accuracy),
                "follows from the efficiency above",
            )
        )
    rows += [
        (
            "accuracy of electrical energy, reduced maps",
            "90.3 %",
            f"{percent(ways['map'].accuracy)}, with the paper's second stage {percent(second)}; "
            f"joint 1 held {percent(held.ways['map'].accuracy)}",
            "section 6 rebuilt (decision 0032); see the table for other excitations",
        ),
        (
            "accuracy of electrical energy, loss model",
            "-",
            f"{percent(ways['losses'].accuracy)}; joint 1 held "
            f"{percent(held.ways['losses'].accuracy)}",
            "ours; same data",
        ),
    ]
    for key, found in stage.items():
        paper = MACHINES[key].paper
        rows.append(
            (
                f"energy of the wall beside the arm's, {MACHINES[key].name}",
                "-" if paper is None else percent(paper, True),
                f"{percent(found['mechanical, magnitude'], True)} magnitude; "
                f"{percent(found['mechanical, positive'], True)} positive; "
                f"{percent(found['mechanical, net'], True)} net mechanical; "
                f"{percent(found['electrical, drives'], True)} electrical",
                "shipped models of the class; the paper says mechanical and not which, and 92 or "
                "93 % without saying which configuration is which",
            )
        )
    return rows


def below_every_joint(result: PaperB) -> list[str]:
    """Runs and definitions whose total accuracy lies below that of every joint."""
    found: list[str] = []
    for run in (VALIDATION, WALL):
        for name, value in result.main.mechanical[run].accuracy.items():
            for total, what in ((value.total, "sum of energies"), (value.summed, "summed power")):
                if total < float(value.joint.min()) - 5e-4:
                    found.append(f"{run}, {name}, {what}")
    return found


def _list(values: Float | tuple[float, ...]) -> str:
    return ", ".join(f"{100 * float(value):.1f}" for value in values) + " %"
