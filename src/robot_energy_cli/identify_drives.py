r"""`robot-energy identify drives`: electrical power of the drives from torque and speed.

Identify how much electrical power the drives take for torque and speed.

With the power of each drive (--drive-power, or drive_power in the mapping of a log): a
reduced efficiency map in four quadrants (paper B, section 6) and a loss model. Both are
compared on held-out data with a constant efficiency and with no losses. The lag of the
power behind the joint states is estimated and removed. With one power meter
for all drives: those losses that its readings determine. If a recording has both kinds of
power, both fits are made.

Record motions at several speeds and loads, and several recordings, so that whole ones
can be held out.

examples:
  robot-energy identify drives cold warm --model kr16 --effort motor_torque \
      --drive-power /drive_power --out my_robot.yaml --plot maps.png
  robot-energy identify drives L0L1.csv L1L2.csv L2L3.csv --ur-rtde --model ur3e \
      --out my_ur3e.yaml
  robot-energy identify drives --log voraus.csv --mapping voraus.yaml
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from robot_energy.foundation.errors import ModelFileError
from robot_energy.foundation.files.temporary_folder import TemporaryFolder
from robot_energy_cli.command import (
    Command,
    Options,
    add_option,
    add_options,
    flags,
    frequency,
)
from robot_energy_cli.identify_inputs import (
    LOG,
    SENSOR_OPTIONS,
    IdentifyInputs,
    bag_options,
    result_options,
)
from robot_energy_cli.terminal import present
from robot_energy_identify.options import OF_DRIVES, IdentifyOptions
from robot_energy_logs.log_formats import LOG_FORMATS

if TYPE_CHECKING:
    from robot_energy.model import RobotModel
    from robot_energy_identify.drives.drive_data import DriveData


def _options(parser: ArgumentParser) -> None:
    effort = (
        "what the effort in the joint states means; without it the model's own torque is used, "
        "rigid bodies and friction"
    )
    add_options(
        parser, {**bag_options(required=False, effort=effort), **flags(IdentifyOptions, OF_DRIVES)}
    )
    for kind in LOG_FORMATS.values():
        if kind.recording is not None:
            words = {"dest": "log_format", "action": "store_const", "const": kind.name}
            add_option(
                parser, f"--{kind.name}", f"the recordings are files of {kind.label}", **words
            )
    cutoff = {"type": frequency, "default": 5.0}
    add_option(
        parser,
        "--cutoff HZ",
        "cut-off frequency of the low-pass of the maps (default 5 Hz)",
        **cutoff,
    )
    results = result_options("these drives", "draw the maps (.png, .svg, .pdf)")
    log: Options = {**LOG, "--mapping FILE": "what their columns mean"}
    log = {"from logs with torque, without a model": log}
    add_options(parser, {**SENSOR_OPTIONS, **results, **log})


def _run(args: Namespace) -> int:
    from robot_energy_identify.drives.all_drives import find_drives
    from robot_energy_identify.plausibility import check_drives, check_total
    from robot_energy_identify.provenance import hashed, identified_from
    from robot_energy_report.drives import efficiency_maps, mapped

    IdentifyInputs(args).check_results()
    _check(args)
    data, model, torque, moved = _data(args)
    source = ", ".join(Path(name).name for name in args.bags or args.log)
    found = find_drives(data, model, source, cutoff=args.cutoff)
    if found.drives is not None:
        check_drives(data, found.drives)
    elif found.total is not None:
        check_total(found.total.data, found.total.ways)
    written, notes = (None, []) if model is None else found.write(model, source)
    if written is not None:
        done, bags = "Losses of the drives identified.", [hashed(Path(name)) for name in args.bags]
        written = written.changed(provenance=identified_from(written.provenance, done, bags))
    report = replace(found, torque=torque, notes=(*moved, *notes))
    maps = mapped(found.drives)
    present(
        args,
        report,
        "Electrical power of the drives",
        f"Identified from {source}.",
        plot=(lambda path: efficiency_maps(maps, path, source)) if maps else None,
        model=written,
    )
    return 0


def _check(args: Namespace) -> None:
    IdentifyInputs(args).check_source()
    if args.log and args.mapping is None:
        raise ModelFileError("the log has no --mapping", "a YAML file that names its columns")
    if args.log and (args.out or args.model or args.effort):
        raise ModelFileError(
            "a log is used without a model and makes none",
            "--log and --mapping alone, or recordings with --model",
            "import the log to a bag",
        )
    if args.log_format and args.drive_power:
        label = LOG_FORMATS[args.log_format].label
        raise ModelFileError(
            f"recordings of {label} have no power of each drive", "no --drive-power"
        )


def _data(args: Namespace) -> tuple[DriveData, RobotModel | None, str, tuple[str, ...]]:
    from robot_energy_identify.drives.drive_data import drive_data, drive_data_of_logs

    if args.log:
        from robot_energy_logs.log_import import contents_of, open_logs
        from robot_energy_logs.mapping import load_mapping

        mapping = load_mapping(args.mapping)
        logs = open_logs(args.log, mapping)
        contents, effort = contents_of(logs, mapping), mapping.joints.effort
        parts = [(contents, [log.whole()]) for log in logs]
        data = drive_data_of_logs(parts, "" if effort is None else effort.si_unit)
        return data, None, "log", ()
    from robot_energy.model import load
    from robot_energy.timeline.blocks import EffortMeaning
    from robot_energy_identify.plausibility import check_signs
    from robot_energy_identify.refused_recordings import (
        on_one_clock,
        refuse_meter,
        refuse_torque,
        torque_evidence,
    )

    model = load(args.model)
    effort, _ = IdentifyInputs(args).bags().meaning()
    with ExitStack() as stack:
        recording = LOG_FORMATS[args.log_format].recording if args.log_format else None
        if recording is not None:
            folder = stack.enter_context(TemporaryFolder()).path
            bags = [
                recording(name, folder / str(number), model.joint_names).bag
                for number, name in enumerate(args.bags)
            ]
        else:
            bags = args.bags
        recordings = IdentifyInputs(args).bags(bags).recordings(model)
        topics = IdentifyInputs(args).drive_power()
        powers = [topics and topics.read(bag, model.joint_names) for bag in bags]
    measured = effort is not EffortMeaning.NONE
    if measured:
        check_signs(recordings, effort)
        refuse_torque([torque_evidence(part, effort) for part in recordings])
    recordings, moved = on_one_clock(recordings)
    refuse_meter(recordings, effort)
    torque = effort.value if measured else "model"
    return drive_data(recordings, powers, measured), model, torque, moved


COMMAND = Command.of(__doc__, _run, _options)
