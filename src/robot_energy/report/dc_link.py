"""What the identification of the DC link found, as tables, figure and JSON."""

from __future__ import annotations

from typing import Any

from robot_energy.identify.cabinet.dc_link import LinkFit
from robot_energy.report.canvas import COLOURS, Target, canvas
from robot_energy.report.printing import Page, line, percent, table

Summary = dict[str, Any]


def link_summary(fit: LinkFit) -> Summary:
    """Return what was found, ready for JSON."""
    return {
        "energy": fit.energy,
        "energy_std": fit.std,
        "energy_interval_95": list(fit.interval),
        "loss_dc_shift": fit.loss_dc_shift,
        "loss_dc_shift_std": fit.loss_dc_shift_std,
        "times_full": fit.events,
        "readings": fit.readings,
        "reading_interval": fit.spacing,
        "emptying_time": fit.emptying,
        "held_out": fit.held_out,
        "ways": {"given": dict(fit.given.__dict__), "identified": dict(fit.identified.__dict__)},
        "tried_energy": fit.tried.tolist(),
        "tried_in_sample_rms": fit.tried_rms.tolist(),
    }


def print_link(summary: Summary, page: Page) -> None:
    """Print what was found.

    Args:
        summary: From `link_summary`.
        page: Where to.
    """
    low, high = summary["energy_interval_95"]
    line(
        page,
        f"energy of the DC link between rectified and chopper voltage: {summary['energy']:.1f} +- "
        f"{summary['energy_std']:.2g} J, 95 % interval {low:.0f} to {high:.0f} J; full "
        f"{summary['times_full']} times, empty again {summary['emptying_time']:.2g} s after it "
        "begins to fill (median)",
    )
    what = "whole recordings" if summary["held_out"] == "recordings" else "contiguous blocks"
    ways = summary["ways"]
    table(
        page,
        f"Power at the grid, {summary['readings']} readings of "
        f"{summary['reading_interval']:.2g} s; {what} held out, drives and "
        "constants as fitted to all",
        ("DC link", "RMS [W]", "energy"),
        [
            (name, f"{ways[way]['rms']:.2f}", percent(ways[way]["energy_error"]))
            for way, name in (("given", "as given"), ("identified", "identified"))
        ],
    )
    line(
        page,
        "if the constant of the DC side were free beside it, it would change by "
        f"{summary['loss_dc_shift']:+.1f} +- {summary['loss_dc_shift_std']:.1g} W; it stays",
    )


def error_over_energy(fit: LinkFit, path: Target) -> None:
    """Draw the error that every energy leaves.

    Args:
        fit: What was found.
        path: File to write: PNG, SVG or PDF by its suffix.

    Raises:
        ReportError: If the suffix is none of these, or the file cannot be written.
    """
    shown = fit.tried <= 3.0 * fit.energy
    with canvas(path, (6.0, 2.8)) as figure:
        axes = figure.subplots()
        axes.plot(fit.tried[shown], fit.tried_rms[shown], ".-", color=COLOURS["predicted"])
        axes.axvspan(*fit.interval, color=COLOURS["predicted"], alpha=0.15, linewidth=0.0)
        axes.axvline(fit.energy, color=COLOURS["measured"], linewidth=0.8)
        axes.set_ylim(bottom=0.0)
        axes.set_xlabel("energy of the DC link [J]")
        axes.set_ylabel("RMS error of power [W]")
