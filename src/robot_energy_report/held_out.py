"""Energy on recordings that the model has not seen: tables and figures."""

from __future__ import annotations

from collections.abc import Sequence

from robot_energy.timeline.blocks import Float, MeterLocation
from robot_energy.timeline.pieces import Compared
from robot_energy_identify.stats.held_out_energy import GIVEN, HeldOutEnergy, Tested
from robot_energy_report.canvas import COLOURS, LINES, Target, panels
from robot_energy_report.document import Column, Document
from robot_energy_report.formats import energy_text, fixed, percent, signed_percent, significant
from robot_energy_report.replay_figures import Role, Series, power_and_energy, series_of

KINDS = {
    "test": "recordings named for the test, not used for the fit",
    "recordings": "each recording predicted by what was identified without it",
    "blocks": "five contiguous blocks of the one recording, each predicted by what was "
    "identified without it",
}
PLACES = {MeterLocation.GRID: "the grid", MeterLocation.DC_BUS: "the DC bus"}
LABELS = {GIVEN: "as given"}


def verdict(test: HeldOutEnergy | None) -> tuple[str, bool]:
    """Return the held-out energy error of both models, and whether the new one is better."""
    if test is None:
        return "the energy of the model was not tested, as asked (--no-test)", False
    if not test.metered:
        return _torque_verdict(test)
    if not test.within:
        return "the energy of the new model was not judged: no recording tests it", False
    last = test.stages[-1]
    kind = "test recordings" if test.kind == "test" else f"held-out {test.kind}"
    what = f"{len(test.within)} {kind if len(test.within) > 1 else kind.removesuffix('s')}"
    where = " at temperatures of their fit" if test.beyond else ""
    errors = [percent(test.mean_error(stage, test.within)) for stage in (GIVEN, last)]
    powers = [f"{test.mean_rms(stage, test.within):.3g} W" for stage in (GIVEN, last)]
    text = (
        f"mean absolute energy error at the meter; {what}{where}: {errors[0]} as given, "
        f"{errors[1]} new; RMS error of power {powers[0]} as given, {powers[1]} new"
    )
    match test.less_energy_error, test.less_power_error:
        case True, True:
            return text, True
        case False, True:
            why = "the new model follows the power better, but its errors cancel less"
        case True, False:
            why = "the energy of the new model is closer, but it follows the power less well"
        case _:
            why = "the new model is not better"
    return f"{why}: {text}", False


def not_judged(test: HeldOutEnergy | None) -> str:
    """Return a sentence or two on recordings outside of the temperatures of their fit, or none."""
    places = [
        f"{entry.name} ({out.joint} at {out.met[0]:.0f} to {out.met[1]:.0f} degC, its fit at "
        f"{out.fitted[0]:.0f} to {out.fitted[1]:.0f} degC)"
        for entry in (test.beyond if test is not None else ())
        if (out := entry.outside) is not None
    ]
    if not places:
        return ""
    text = f"outside the range of the fit, so not judged: {', '.join(places)}"
    if test is not None and test.kind == "test":
        return f"{text}. Add a recording at such temperatures to the fit"
    return (
        f"{text}. The new model is made of all recordings and knows these temperatures; test it "
        "there with another recording (--test)"
    )


def _torque_verdict(test: HeldOutEnergy) -> tuple[str, bool]:
    """The same by the torque, where no held-out recording has a power meter."""
    meter = "no held-out recording has a power meter, so the energy was not tested"
    if not test.with_torque:
        return f"{meter}; record the meter's topic too", False
    given, new = (test.torque_error(stage) for stage in (GIVEN, test.stages[-1]))
    better = new < given
    return (
        f"{'' if better else 'the new model is not better: '}motor torque held out, norm of "
        f"error over norm of torque: {percent(given)} as given, {percent(new)} new; {meter}"
    ), better


def verdict_line(test: HeldOutEnergy | None, page: Document) -> None:
    """Add the verdict; as a note where the new model is not better."""
    text, better = verdict(test)
    page.paragraph(text, "strong" if better else "note")
    if outside := not_judged(test):
        page.note(outside)


def held_out_document(test: HeldOutEnergy, names: tuple[str, ...], page: Document) -> None:
    """Add the test of the whole."""
    page.paragraph(f"held out: {KINDS[test.kind]}")
    verdict_line(test, page)
    taken = {subject for entry in test.tested for subject in entry.taken}
    stages = [GIVEN, *(stage for stage in test.stages if stage in taken)]  # that changed something
    last = test.stages[-1]
    if test.metered:
        _energy_tables(test, stages, page)
    page.rows(
        "Shaft energy of all axes, error over that measured either way, held out",
        [
            Column("recording", "name"),
            Column("measured", "shaft_either_way", energy_text),
            Column("as given", lambda entry: entry.shaft_error(GIVEN), signed_percent),
            Column("new model", lambda entry: entry.shaft_error(last), signed_percent),
        ],
        test.with_torque,
    )
    page.rows(
        "Motor torque of all axes, norm of error over norm of torque, held out",
        [
            Column("recording", "name"),
            Column("as given", lambda entry: entry.predictions[GIVEN].torque_error, percent),
            Column("new model", lambda entry: entry.predictions[last].torque_error, percent),
        ],
        test.with_torque,
    )
    _figures(test, names, page)


def _energy_tables(test: HeldOutEnergy, stages: list[str], page: Document) -> None:
    last = test.stages[-1]
    for entries, where in ((test.within, ""), (test.beyond, "; outside the range of the fit")):
        page.rows(
            f"Energy at {_place(test.metered[0])}, predicted / measured - 1, held out{where}",
            [
                Column("recording", "name"),
                Column("measured", "measured", energy_text),
                *(
                    Column(
                        LABELS.get(stage, f"+{stage}"),
                        lambda entry, stage=stage: entry.error(stage),
                        signed_percent,
                        total=lambda rows, stage=stage: percent(test.mean_error(stage, rows)),
                    )
                    for stage in stages
                ),
                *([Column("beyond", lambda entry: f"{entry.beyond:.0f} K")] if where else []),
            ],
            entries,
            "" if where else "mean size",
        )
    if "dynamics" in stages and "friction" in stages:
        page.paragraph(
            "the dynamics alone know friction at one temperature; the next step knows more"
        )
    partial = [e.name for e in test.metered if set(stages[1:]) - set(e.taken)]
    if partial and test.kind != "test":
        page.paragraph(f"not every step was possible or of use without {', '.join(partial)}")
    page.rows(
        f"Power at {_place(test.metered[0])} from reading to reading, RMS error, held out [W]",
        [
            Column("recording", "name"),
            Column("compared", lambda entry: f"{fixed(1)(entry.duration)} s"),
            Column("as given", lambda entry: entry.predictions[GIVEN].rms, significant(4)),
            Column("new model", lambda entry: entry.predictions[last].rms, significant(4)),
        ],
        test.metered,
    )


def _place(entry: Tested) -> str:
    return PLACES.get(entry.location or MeterLocation.UNKNOWN, "the meter")


def _figures(test: HeldOutEnergy, names: tuple[str, ...], page: Document) -> None:
    worst, last = test.worst, test.stages[-1]
    if worst is not None:
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
    page.figure(
        lambda path: _torque_over_time(names, shown, last, path),
        f"Motor torque on a held-out piece of `{shown.name}`.",
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


def _torque_over_time(names: Sequence[str], piece: Tested, last: str, path: Target) -> None:
    """Draw one panel per joint: measured torque, and predicted torque of both models."""
    curves: tuple[tuple[str, Role, Float], ...] = (
        ("measured", "measured", piece.motor_torque),
        ("as given", "fixed", piece.predictions[GIVEN].motor_torque),
        ("new model", "predicted", piece.predictions[last].motor_torque),
    )
    labels = "time since the start of the recording [s]", "motor torque [N m]"
    with panels(path, names, (4.6, 1.7), (0.0, 0.6), labels, 2) as (figure, grid):
        for joint, axes in enumerate(grid):
            for label, role, torque in curves:
                style = {"linestyle": LINES[role], "color": COLOURS[role], "label": label}
                axes.plot(piece.time, torque[:, joint], **style, linewidth=0.9)
            axes.margins(x=0.0)
        handles, texts = grid[0].get_legend_handles_labels()
        figure.legend(handles, texts, loc="outside upper right", ncols=len(texts))
