"""What `identify cabinet` found: constant losses and DC link."""

from __future__ import annotations

from typing import Any

from robot_energy.identify.cabinet.supply import SupplyFound
from robot_energy.report.dc_link import link_summary, print_link
from robot_energy.report.drives import delay_text
from robot_energy.report.identification import cabinet_summary, print_cabinet
from robot_energy.report.printing import NOTE, Page, line

Summary = dict[str, Any]


def supply_summary(found: SupplyFound) -> Summary:
    """Return what was found, ready for JSON: the constants, and under ``capacitor`` the link."""
    return {
        **cabinet_summary(found.cabinet),
        "meter_delay": None if found.delay is None else dict(found.delay.__dict__),
        "capacitor": {
            "taken": found.link is not None and not found.reason,
            "reason": found.reason or None,
            "note": found.note or None,
            "found": None if found.link is None else link_summary(found.link),
        },
    }


def print_supply(summary: Summary, page: Page) -> None:
    """Print what was found.

    Args:
        summary: From `supply_summary`.
        page: Where to.
    """
    print_cabinet(summary, page)
    if summary["meter_delay"] is not None:
        line(page, delay_text("the meter", summary["meter_delay"]))
    link = summary["capacitor"]
    if link["found"] is not None:
        print_link(link["found"], page)
    if link["reason"] is not None:
        line(page, f"{NOTE}DC link as given: {link['reason']}")
    if link["note"] is not None:
        line(page, f"{NOTE}{link['note']}")
