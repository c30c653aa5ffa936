"""What was learned of a robot: lasting changes of friction, and figures against the model file."""

from __future__ import annotations

from robot_energy.report.document import Column, Document
from robot_energy.report.formats import fixed
from robot_energy.results.condition import ConditionReport


def condition_section(page: Document, report: ConditionReport | None) -> None:
    """Add what was learned over one recording, or over many in order.

    Args:
        page: Where to.
        report: Of the learner after the last recording; None adds nothing.
    """
    if report is None:
        return
    for change in report.wear:
        page.paragraph(change.sentence, "note" if change.fell else "problem")
    known = [joint for joint in report.joints if joint.valid]
    with page.only("page"):
        if known:
            page.rows(
                "Friction against the model file, from measured torque",
                [
                    Column("", "name"),
                    Column("multiplier", "multiplier", fixed(3)),
                    Column("last minute", "multiplier_raw", fixed(3)),
                    Column("records", "records"),
                ],
                known,
            )
        if report.meter_valid:
            page.paragraph(
                f"from the power meter: constant losses {report.loss_offset:+.1f} W"
                + ("" if known else f", friction x {report.friction_factor:.3f}")
                + " against the model file"
            )
