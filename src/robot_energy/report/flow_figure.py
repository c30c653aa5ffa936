"""Figure of where the energy from the grid went: axis by axis, then cabinet and brake."""

from __future__ import annotations

from robot_energy.report.canvas import MAX_TICK, SERIES, Target, canvas
from robot_energy.report.energy import part_names, scale_of
from robot_energy.report.formats import percent
from robot_energy.report.prediction_figure import PARTS
from robot_energy.results.energy import EnergyReport
from robot_energy.shown_text import shown

ROW = 0.34  # inch per row
COLOURS_OF_PARTS = {
    key: colour for colour, keys in zip(SERIES, PARTS.values(), strict=False) for key in keys
}
JOINT_PARTS = {"friction": "friction_energy", "drive_loss": "drive_loss_energy",
               "rigid": "rigid_energy"}  # fmt: skip
CABINET = ("loss_dc", "loss_grid", "brake", "capacitor")


def energy_flow(report: EnergyReport, path: Target) -> None:
    """Draw the energy from the grid, and below it the pieces that it was split into.

    Each row begins where the one above ended, so the pieces make up the whole; the numbers
    on the rows add up to the last digit. What is given back, such as by a body that is lower
    in the end, goes back to the left and is hatched.

    Args:
        report: Of a replay or prediction.
        path: File to write: PNG, SVG or PDF by its suffix.
    """
    from matplotlib.patches import Patch

    energy, scale = report.energy, scale_of([report.energy])
    names = part_names(report.model.drive)
    rows: list[tuple[str, list[tuple[str, float]]]] = [
        (shown(joint.name, MAX_TICK), [(key, getattr(joint, name)) for key, name in
                                       JOINT_PARTS.items()])
        for joint in report.joints
    ]  # fmt: skip
    rows += [(names[key], [(key, value)]) for key in CABINET if (value := getattr(energy, key))]
    sums = [sum(value for _, value in pieces) for _, pieces in rows]
    known = dict(zip(names, scale.parts([getattr(energy, key) for key in names]), strict=True))
    cabinet = [known[key] for key in CABINET if getattr(energy, key)]  # as in the table
    axes_sum = float(scale.joule(energy.net)) - sum(map(float, cabinet))
    count = len(report.joints)
    texts = [*scale.parts(sums[:count], f"{axes_sum:.{scale.digits}f}"), *cabinet]
    with canvas(path, (8.0, ROW * (len(rows) + 1) + 1.0)) as figure:
        axes = figure.subplots()
        end, met = 0.0, dict.fromkeys(COLOURS_OF_PARTS, 0.0)
        for place, (_, pieces) in enumerate(rows, 1):
            for key, value in pieces:
                _piece(axes, place, end, value / scale.factor, COLOURS_OF_PARTS[key])
                end += value / scale.factor
                met[key] += abs(value)
        begin = 0.0
        for key in COLOURS_OF_PARTS:
            value = getattr(energy, key) / scale.factor
            _piece(axes, 0, begin, value, COLOURS_OF_PARTS[key])
            begin += value
        far = axes.get_xlim()[1]
        for place, (value, text) in enumerate(
            zip((energy.net, *sums), (scale.joule(energy.net), *texts), strict=True)
        ):
            share = f"   {percent(value / energy.net)}" if energy.net > 0 else ""
            axes.annotate(
                f"{text} {scale.unit}{share}", (1.0, place), xycoords=("axes fraction", "data"),
                xytext=(4, 0), textcoords="offset points", va="center",
                weight="bold" if place == 0 else "normal", annotation_clip=False,
            )  # fmt: skip
        axes.set_yticks(range(len(rows) + 1), ["from the grid", *(name for name, _ in rows)])
        axes.invert_yaxis()
        axes.grid(visible=False, axis="y")
        axes.set_xlim(axes.get_xlim()[0], far)
        axes.set_xlabel(f"energy [{scale.unit}]")
        shown_parts = [(name, keys) for name, keys in PARTS.items() if any(met[k] for k in keys)]
        axes.legend(
            handles=[Patch(color=COLOURS_OF_PARTS[keys[0]], label=n) for n, keys in shown_parts],
            loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(shown_parts),
        )  # fmt: skip


def _piece(axes: object, place: int, start: float, width: float, colour: str) -> None:
    """One piece; one that goes back is drawn thin and hatched over those before it."""
    back = width < 0
    axes.barh(  # type: ignore[attr-defined]
        place, width, 0.3 if back else 0.62, left=start,
        color="white" if back else colour, edgecolor=colour, hatch="////" if back else "",
        linewidth=0.8 if back else 0.0, zorder=3 if back else 2,
    )  # fmt: skip
