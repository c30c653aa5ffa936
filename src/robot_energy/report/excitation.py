"""What an excitation motion tells and what it uses of the limits."""

from __future__ import annotations

from robot_energy.report.document import Column, Document
from robot_energy.report.formats import NOTHING, fixed, percent, significant
from robot_energy.results.base import known
from robot_energy.results.excitation import KINDS, ExcitationReport


def excitation_document(report: ExcitationReport, page: Document) -> None:
    """Add what an excitation motion tells and uses.

    Args:
        report: The motion.
        page: Where to.
    """
    named = (
        ("condition number", "condition"),
        ("log determinant per parameter", "log_determinant"),
    )
    settings = report.settings
    page.rows(
        f"Observation matrix of {len(report.base_parameters)} base parameters, "
        f"{settings.harmonics} harmonics of {1.0 / settings.period:.4g} Hz, {settings.period:g} s",
        [
            Column("", lambda row: row[0]),
            Column(
                "best random start",
                lambda row: known(getattr(report.before, row[1])),
                significant(4),
            ),
            Column("optimised", lambda row: known(getattr(report.after, row[1])), significant(4)),
        ],
        named,
    )
    page.rows(
        "Start pose, and use of the limits of URDF and robot (at most "
        f"{100 * report.margin:.0f} % was allowed)",
        [
            Column("joint", "name"),
            Column("start", "start", fixed(4), "rad or m"),
            *(Column(kind, lambda joint, kind=kind: joint.use[kind], percent) for kind in KINDS),
        ],
        report.joints,
    )
    if report.floor is not None:
        page.paragraph(
            f"{report.floor.link} stays above {report.least_height:.3f} m "
            f"({report.floor.height:g} m allowed)"
        )
    else:
        page.note("no link is kept above a floor; --floor and --tool do")
    silent = report.after.not_excited
    excited = [name for name in report.base_parameters if name not in silent]
    count = len(report.base_parameters)
    with page.only("terminal"):
        page.paragraph(f"excited: {len(excited)} of {count} base parameters")
    with page.only("page"):
        page.paragraph(f"excited, {len(excited)} of {count}: {', '.join(excited) or NOTHING}")
    page.paragraph(f"not excited: {', '.join(silent) or NOTHING}")
    page.paragraph(f"no torque depends on: {', '.join(report.without_effect) or NOTHING}")
    if report.acceleration_assumed:
        page.note(
            "a URDF knows no acceleration limits; full speed in 0.5 s is assumed, "
            "--acceleration gives those of the robot"
        )
    if any(joint.use["torque"] is None for joint in report.joints):
        page.note("the URDF gives no torque limit for some joints; none was kept there")
    page.note(
        "collisions of the robot with itself and its surroundings are not checked; play "
        "the motion in simulation, then slowly, before recording it"
    )
