"""Energy on recordings that the model has not seen: tables, figures and JSON."""

from __future__ import annotations

import math
from typing import Any

from robot_energy.blocks import MeterLocation
from robot_energy.identify.stats.held_out_energy import GIVEN, OUTSIDE, HeldOutEnergy, Tested
from robot_energy.report.document import Document
from robot_energy.report.energy_figure import energy_errors
from robot_energy.report.power_figure import power_and_energy
from robot_energy.report.printing import NOTE, NOTHING, Page, energy_text, line, percent, table
from robot_energy.report.series import Role, Series, series_of
from robot_energy.report.torque_figure import TorqueCurve, torque_over_time
from robot_energy.timeline.pieces import Compared

KINDS = {
    "test": "recordings named for the test, not used for the fit",
    "recordings": "each recording predicted by what was identified without it",
    "blocks": "five contiguous blocks of the one recording, each predicted by what was "
    "identified without it",
}
PLACES = {MeterLocation.GRID: "the grid", MeterLocation.DC_BUS: "the DC bus"}
LABELS = {GIVEN: "as given"}


def stages_shown(test: HeldOutEnergy) -> list[str]:
    """Return the model as given and the steps that changed a held-out prediction."""
    taken = {subject for entry in test.tested for subject in entry.taken}
    return [GIVEN, *(stage for stage in test.stages if stage in taken)]


def verdict(test: HeldOutEnergy | None) -> str:
    """Return the energy error of both models on held-out data, in one sentence."""
    if test is None or not test.metered:
        return (
            f"{NOTE}no recording has a power meter, so the energy of the model was not tested; "
            "record the meter's topic too"
        )
    last = test.stages[-1]
    kind = "test recordings" if test.kind == "test" else f"held-out {test.kind}"
    parts: list[str] = []
    for entries, where in (
        (test.within, "at temperatures of their fit" if test.beyond else ""),
        (test.beyond, "colder or warmer than their fit"),
    ):
        if entries:
            given, new = (percent(test.mean_error(stage, entries)) for stage in (GIVEN, last))
            what = f"{len(entries)} {kind if len(entries) > 1 else kind.removesuffix('s')}"
            parts.append(f"{' '.join((what, where)).strip()}: {given} as given, {new} new")
    given, new = (test.mean_rms(stage, test.judged) for stage in (GIVEN, last))
    text = (
        f"energy error at the meter, mean size; {'; '.join(parts)}; RMS error of power "
        f"{given:.3g} W as given, {new:.3g} W new"
    )
    match test.less_energy_error, test.less_power_error:
        case True, True:
            return text
        case False, True:
            why = "the new model follows the power better, but its errors cancel less"
        case True, False:
            why = "the energy of the new model is closer, but it follows the power less well"
        case _:
            why = "the new model is not better"
    return f"{NOTE}{why}: {text}"


def print_energy(test: HeldOutEnergy, names: tuple[str, ...], page: Page) -> None:
    """Print the test of the whole; a document gets figures too.

    Args:
        test: The test.
        names: Of the joints.
        page: Where to.
    """
    line(page, f"held out: {KINDS[test.kind]}")
    line(page, verdict(test))
    stages = stages_shown(test)
    if test.metered:
        _energy_table(test, stages, page)
    if test.with_torque:
        last = test.stages[-1]
        table(
            page,
            "Shaft energy of all axes, predicted over measured less 1, held out",
            ("recording", "measured", "as given", "new model"),
            [
                (
                    entry.name,
                    energy_text(entry.shaft),
                    percent(entry.shaft_error(GIVEN), True),
                    percent(entry.shaft_error(last), True),
                )
                for entry in test.with_torque
            ],
        )
    if isinstance(page, Document):
        _figures(test, names, page)


def _energy_table(test: HeldOutEnergy, stages: list[str], page: Page) -> None:
    last = test.stages[-1]
    table(
        page,
        f"Energy at {_place(test.metered[0])}, predicted over measured less 1, held out",
        ("recording", "measured", *(LABELS.get(stage, f"+{stage}") for stage in stages), "beyond"),
        [
            (
                entry.name,
                energy_text(entry.measured),
                *(percent(entry.error(stage), True) for stage in stages),
                f"{entry.beyond:.0f} K" if entry.beyond > OUTSIDE else NOTHING,
            )
            for entry in test.metered
        ],
        ("mean size", "", *(percent(test.mean_error(stage)) for stage in stages), ""),
    )
    if test.beyond:
        line(
            page,
            f"{NOTE}beyond: so much colder or warmer was a motor than in the recordings of that "
            "fit, where friction is held at the edge. The new model is made of all recordings and "
            "knows these temperatures",
        )
    if "dynamics" in stages and "friction" in stages:
        line(page, "the dynamics alone know friction at one temperature; the next step knows more")
    partial = [e.name for e in test.metered if set(stages[1:]) - set(e.taken)]
    if partial and test.kind != "test":
        line(page, f"not every step was possible or of use without {', '.join(partial)}")
    table(
        page,
        f"Power at {_place(test.metered[0])} from reading to reading, RMS error, held out [W]",
        ("recording", "compared", "as given", "new model"),
        [
            (
                entry.name,
                f"{entry.duration:.1f} s",
                f"{entry.predictions[GIVEN].rms:.4g}",
                f"{entry.predictions[last].rms:.4g}",
            )
            for entry in test.metered
        ],
    )


def _place(entry: Tested) -> str:
    return PLACES.get(entry.location or MeterLocation.UNKNOWN, "the meter")


def _figures(test: HeldOutEnergy, names: tuple[str, ...], page: Document) -> None:
    worst, last = test.worst, test.stages[-1]
    if worst is not None:
        page.figure(
            lambda path: energy_errors(
                [entry.name for entry in test.metered],
                [entry.error(GIVEN) for entry in test.metered],
                [entry.error(last) for entry in test.metered],
                path,
                [entry.beyond > OUTSIDE for entry in test.metered],
            ),
            "Energy error on what was held out."
            + (" Hatched: colder or warmer than the fit has seen." if test.beyond else ""),
        )
        series, what = _power(test, worst)
        if series:
            page.figure(
                lambda path: power_and_energy(series, path, "", _place(worst)),
                f"Power and energy at {_place(worst)}, measured and predicted, {what}.",
            )
    shown = max(
        (entry for entry in test.tested if len(entry.time)),
        key=lambda entry: entry is worst,
        default=None,
    )
    if shown is None or not test.with_torque:
        return
    curves = [
        TorqueCurve("as given", "fixed", shown.predictions[GIVEN].motor_torque),
        TorqueCurve("new model", "predicted", shown.predictions[last].motor_torque),
    ]
    for residual, text in (
        (False, "Motor torque on a held-out piece"),
        (True, "Residual torque, predicted minus measured, on the same piece"),
    ):
        page.figure(
            lambda path, residual=residual: torque_over_time(
                names, shown.time, shown.motor_torque, curves, path, residual
            ),
            f"{text} of `{shown.name}`."
            + (" Peaks beyond the axis: 1 % of the samples." if residual else ""),
        )


def _power(test: HeldOutEnergy, worst: Tested) -> tuple[list[Series], str]:
    """Curves of the worst recording, or of all blocks put together."""
    last = test.stages[-1]
    parts = list(test.metered) if test.kind == "blocks" else [worst]
    curves: list[Series] = []
    models: tuple[tuple[str, str, Role], ...] = (
        (GIVEN, "model as given", "fixed"),
        (last, "new model", "predicted"),
    )
    for stage, label, role in models:
        compared: list[Compared] = [c for p in parts for c in p.predictions[stage].compared]
        pair = series_of(compared, worst.start_ns, label, role)
        if pair is not None:
            curves += pair if not curves else pair[1:]
    if test.kind == "blocks":
        return curves, "every block predicted by what was identified without it"
    return curves, f"on `{worst.name}`, the held-out recording with the greatest energy error" + (
        " at temperatures of its fit" if test.beyond else ""
    )


def energy_summary(test: HeldOutEnergy | None) -> dict[str, Any] | None:
    """Return the test, ready for JSON; None where there was none."""
    if test is None:
        return None
    return {
        "held_out": test.kind,
        "stages": list(test.stages),
        "recordings": [
            {
                "name": entry.name,
                "compared_time": entry.duration,
                "measured_energy": _finite(entry.measured),
                "measured_shaft_energy": _finite(entry.shaft),
                "beyond_fit_kelvin": entry.beyond,
                "taken": list(entry.taken),
                "predicted": {
                    stage: {
                        "energy": part.energy if entry.measured > 0 else None,
                        "relative": _finite(entry.error(stage)),
                        "rms": _finite(part.rms),
                        "shaft_energy": _finite(part.shaft),
                    }
                    for stage, part in entry.predictions.items()
                },
            }
            for entry in test.tested
        ],
        "mean_error": {
            stage: _finite(test.mean_error(stage)) if test.metered else None
            for stage in test.stages
        },
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
