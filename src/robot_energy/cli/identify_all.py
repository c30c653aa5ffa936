"""`robot-energy identify all`: everything that recordings allow, one model and one report."""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robot_energy.cli.identify_inputs import (
    add_bags,
    add_link_voltages,
    add_results,
    check_results,
    command_of,
    link_voltages,
    read_sources,
)
from robot_energy.cli.terminal import console, progress, write_text
from robot_energy.errors import ModelFileError, NotIdentifiableError

if TYPE_CHECKING:
    from robot_energy.identify.bags import Bag, BagFacts, Span
    from robot_energy.identify.everything import Everything
    from robot_energy.model_file import RobotModel

SUBJECTS = ("dynamics", "friction", "cabinet", "drives", "capacitor")

DESCRIPTION = """\
Identify everything that the recordings allow, in the order of the power: bodies and rotors
from measured torque, friction over temperature, constant losses of the cabinet, losses of the
drives, energy that the DC link stores. What they do not allow is left as the model has it, with
a sentence that says what to record. Then the energy of the old and the new model is compared
with the meter on recordings that the fit has not seen: whole recordings in turn, or those of
--test.
"""
EPILOG = """\
examples:
  robot-energy identify all cold warm hot --model my_robot.yaml --effort motor_torque \\
      --out identified.yaml --report report.html
  robot-energy identify all cold warm hot --test another_day --model my_robot.yaml \\
      --effort motor_current --drive-power /drive_power --out identified.yaml
"""


def add_parser(commands: Any) -> None:
    """Add the sub-command."""
    parser: ArgumentParser = commands.add_parser(
        "all",
        help="everything the recordings allow, with one report",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=RawDescriptionHelpFormatter,
    )
    add_bags(
        parser,
        effort="what the effort in the joint states means; without it neither bodies nor "
        "friction can be identified",
    )
    parser.add_argument(
        "--test", nargs="+", default=[], metavar="BAG", help="recordings for the test alone"
    )
    parser.add_argument(
        "--drive-power", metavar="TOPIC", help="array with the power of each drive [W]"
    )
    parser.add_argument(
        "--drive-joints",
        nargs="+",
        metavar="JOINT",
        help="joints in the order of that array (default: of the model)",
    )
    parser.add_argument(
        "--skip", nargs="+", choices=SUBJECTS, default=[], help="leave these as the model has them"
    )
    parser.add_argument(
        "--no-test", action="store_true", help="do not test the energy on held-out recordings"
    )
    add_link_voltages(parser)
    add_results(parser, "all that was identified")
    parser.set_defaults(run=run)


def run(args: Namespace) -> int:
    """Identify, test and report.

    Raises:
        RobotEnergyError: If bags or model cannot be used, or nothing can be identified.
    """
    from robot_energy.identify.bags import facts
    from robot_energy.identify.everything import identify_everything, with_provenance
    from robot_energy.identify.held_out_energy import folds_of, held_out_energy
    from robot_energy.model_file import load, save
    from robot_energy.report.document import Document
    from robot_energy.report.identification_document import (
        Identification,
        identification_summary,
        print_identification,
    )

    check_results(args)
    _check(args)
    voltages = link_voltages(args)
    model = load(args.model)
    bags, refused = _bags(args, model, args.bags)
    tests, _ = _bags(args, model, args.test)
    known: list[tuple[BagFacts, Span]] = []
    for bag in (*bags, *tests):
        with progress(f"reading {bag.name}") as report:
            recording = bag.whole(model, report)
        known.append((facts(bag, recording), recording.span_ns))
    read = [entry for entry, _ in known[: len(bags)]]
    with progress("identifying") as report:
        whole = identify_everything(
            bags, model, args.skip, lambda _, share: report(share), refused, voltages
        )
    _require_something(whole)
    test = None
    if not args.no_test:
        kind, folds = folds_of(bags, tests, [span for _, span in known])
        with progress("testing on what was held out") as report:
            test = held_out_energy(kind, folds, whole, args.skip, lambda _, share: report(share))
    written = with_provenance(whole, read)
    if args.out is not None:
        save(written, args.out)
    found = Identification(
        whole,
        written,
        read,
        [entry for entry, _ in known[len(bags) :]],
        test,
        command_of(args),
        args.out or "",
    )
    if args.json is not None:
        summary = identification_summary(found)
        write_text(args.json, json.dumps(summary, indent=2, allow_nan=False) + "\n")
    if args.report is not None:
        page = Document(f"Identification of {model.robot.type}", found.lead)
        print_identification(found, page)
        page.write(args.report)
    if args.json != "-":  # last: the reader of a pipe may close it early
        out = console()
        print_identification(found, out)
        for what, path in (("model file", args.out), ("report", args.report)):
            if path is not None:
                out.print(f"wrote {path}: {what}", soft_wrap=True)
    return 0


def _check(args: Namespace) -> None:
    """Refuse options that do not fit together."""
    if args.drive_joints and not args.drive_power:
        raise ModelFileError("--drive-joints without --drive-power", "both or none")
    if args.test and args.no_test:
        raise ModelFileError("--test and --no-test exclude each other", "one of them")
    places = [Path(bag).resolve() for bag in (*args.bags, *args.test)]
    twice = sorted({place.name for place in places if places.count(place) > 1})
    if twice:
        raise ModelFileError(
            f"the recording {', '.join(twice)} is named twice",
            "every recording once",
            "a test on a recording of the fit would show nothing",
        )
    if set(args.skip) == set(SUBJECTS):
        raise ModelFileError("--skip leaves nothing to identify", "fewer subjects")


def _bags(args: Namespace, model: RobotModel, paths: Sequence[str]) -> tuple[list[Bag], str]:
    """The bags, and why their effort cannot be used; empty if it can, or was not told."""
    from robot_energy.blocks import EffortMeaning
    from robot_energy.identify.bags import Bag
    from robot_energy.identify.drive_power import read_drive_power
    from robot_energy.identify.everything import usable_effort

    effort, inputs = read_sources(args)
    refused = usable_effort(model, effort)
    used = EffortMeaning.NONE if refused else effort
    return [
        Bag(
            Path(path),
            used,
            inputs,
            read_drive_power(path, args.drive_power, model.joint_names, args.drive_joints)
            if args.drive_power
            else None,
        )
        for path in paths
    ], refused


def _require_something(whole: Everything) -> None:
    """Refuse to report where not one step could be done.

    Raises:
        NotIdentifiableError: With the reason of every step.
    """
    if all(step.found is None for step in whole.steps):
        reasons = " ".join(f"{step.subject.capitalize()}: {step.reason}" for step in whole.steps)
        raise NotIdentifiableError(f"nothing can be identified from these recordings. {reasons}")
