"""Report of the identified powers of auxiliary loads."""

from __future__ import annotations

from robot_energy.report.document import Document
from robot_energy.report.formats import fixed, signed_percent, uncertain
from robot_energy.results.load_states import LoadStatesReport


def states_document(report: LoadStatesReport, page: Document) -> None:
    """Add the identified powers of states.

    Args:
        report: What was found.
        page: Where to.
    """
    page.table(
        "Power of each state [W]",
        ("load", "state", "power", "given", "readings", "times", "by"),
        [
            (
                one.load,
                one.state,
                fixed(1)(one.power) if one.std is None else uncertain(one.power, one.std),
                fixed(1)(one.before),
                str(one.readings),
                str(one.visits),
                fit.source,
            )
            for fit in report.fits
            for one in fit.states
        ],
    )
    rows = [
        (
            ", ".join(fit.loads),
            held.what,
            fixed(1)(held.rms),
            fixed(1)(held.rms_before),
            signed_percent(held.energy_error),
            "yes" if fit.used else "no",
        )
        for fit in report.fits
        if (held := fit.held_out) is not None
    ]
    if rows:
        columns = ("load", "held out", "RMS [W]", "with the given model", "energy", "used")
        page.table("What the fit has not seen: predicted less measured", columns, rows)
    page.notes([note for fit in report.fits for note in fit.notes] + list(report.refused))
