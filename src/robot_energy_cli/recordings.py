"""Commands about recordings: `robot-energy info`, `check`, `test` and `import`."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robot_energy.foundation.errors import ModelFileError
from robot_energy.foundation.process_memory import keep_freed_memory
from robot_energy.messages.fields import JOINT_STATES_TOPIC, METER_TOPIC, TEMPERATURES_TOPIC
from robot_energy_cli.command import LIST, Command, Group, Options, add_option
from robot_energy_cli.identify_inputs import IdentifyInputs, bag_options
from robot_energy_cli.replay_arguments import (
    AT_FALLBACK,
    BAG,
    DAMAGED,
    model_named,
    options_given,
    replay_options,
)
from robot_energy_cli.terminal import (
    JSON_OPTION,
    TABLE_OUTPUTS,
    check_outputs,
    console,
    present,
    progress,
    write_json,
    wrote,
)
from robot_energy_logs.log_formats import LOG_FORMATS, LogFormat

if TYPE_CHECKING:
    from robot_energy.bag import BagReader
    from robot_energy_identify.check import CheckResult
    from robot_energy_identify.results.evaluation import EvaluationReport
    from robot_energy_logs.recording import ImportReport


def _info(args: Namespace) -> int:
    """`robot-energy info`: topics, types, counts and time span of a bag.

    Print the topics of a bag and what replay can use them for.
    """
    from robot_energy.bag import BagReader
    from robot_energy_report.document import Document
    from robot_energy_report.formats import utc
    from robot_energy_report.printing import print_document

    bag = BagReader(args.bag)
    counts: dict[str, int | None] = {name: info.message_count for name, info in bag.topics.items()}
    start, end = bag.start_ns, bag.end_ns
    if None in counts.values() or start is None:
        counts, start, end = _read(bag, counts)
    span = None
    if start is not None and end is not None:
        span = f"from {utc(start, '%F %T')} UTC, {(end - start) * 1e-9:.3f} s"
    rows = [
        (name, info.msgtype, "?" if counts[name] is None else str(counts[name]), _use(info.msgtype))
        for name, info in bag.topics.items()
    ]
    page = Document()
    page.paragraph(f"{args.bag}: {span or 'no messages'}", "strong")
    if bag.origin:
        page.paragraph(f"origin: {bag.origin}")
    for problem in bag.problems:
        page.paragraph(problem, "problem")
    page.table("", ("topic", "type", "messages", "used as"), rows)
    print_document(page, console())
    return DAMAGED if bag.problems else 0


def _use(msgtype: str) -> str:
    from robot_energy.inputs.bag_topics import temperatures_by_type
    from robot_energy.inputs.joint_states.joint_states import JOINT_STATE
    from robot_energy.inputs.meter.kinds import meter_kind

    if msgtype == JOINT_STATE:
        return "joint states"
    if msgtype in temperatures_by_type():
        return "temperatures"
    return "meter" if meter_kind(msgtype).found_by_type else ""


def _read(
    bag: BagReader, counts: dict[str, int | None]
) -> tuple[dict[str, int | None], int | None, int | None]:
    readable = [name for name, info in bag.topics.items() if info.encoding == "cdr"]
    found: dict[str, int | None] = {**counts, **dict.fromkeys(readable, 0)}
    start = end = None
    for part in bag.parts(readable):
        for name, batch in part.items():
            found[name] = (found[name] or 0) + len(batch)
            low, high = int(batch.log_time_ns.min()), int(batch.log_time_ns.max())
            start = low if start is None else min(start, low)
            end = high if end is None else max(end, high)
    return found, start, end


INFO = Command.of(_info.__doc__, _info, {"bag": "MCAP file, or rosbag2 folder"})

MISTAKES = 2  # exit code: a recording does not fit
STYLES = {"error": "bold red", "warning": "yellow", "note": "dim"}


def _check(args: Namespace) -> int:
    r"""`robot-energy check`: does a recording fit a model, and what is wrong if not.

    Check recordings against a model: units, order, sign and zero of every joint, scale and meaning
    of the torque, gear ratios, payload, meter, temperatures, noise at rest, and what could be
    identified. Each finding has its size and the setting that corrects it, tried on the recording.
    Causes that explain a recording equally well are listed together; the recording does not decide
    between them. Several recordings of one robot are judged together.

    examples:
      robot-energy check bag --model kr16 --effort motor_torque
      robot-energy check monday tuesday --model my_robot.yaml --inputs energy_monitor.yaml \
          --json c.json

    exit codes: 0 no mistake found; 2 a mistake found, or input refused
    """
    from robot_energy.model import load
    from robot_energy_identify.check import check_together
    from robot_energy_identify.results.check import CheckReport

    named = model_named(args)
    check_outputs(args, [*args.bags, named, args.inputs])
    effort, inputs = IdentifyInputs(args).bags().meaning()
    model = load(named)
    results = check_together(args.bags, model, effort, inputs)
    if args.json != "-":
        for result in results:
            _show(result)
    if args.json is not None:
        write_json(args.json, CheckReport(results).to_dict())
    if args.json not in (None, "-"):
        wrote(console(), args.json, "all figures as JSON")
    return MISTAKES if any(result.errors for result in results) else 0


def _show(result: CheckResult) -> None:
    show = console().print
    errors = len(result.errors)
    show(f"{result.recording} with {result.model}", style="bold")
    if errors:
        show(f"{errors} mistake{'s' if errors > 1 else ''} found", style=STYLES["error"])
    else:
        show(f"no mistake found; checked: {', '.join(result.checked) or 'nothing'}")
    for finding in result.findings:
        show(f"{finding.severity}: {finding.sentence}", style=STYLES[finding.severity])
        if finding.remedy:
            place = f"   # {finding.remedy_in}" if finding.remedy_in else ""
            show(f"    remedy: {finding.remedy}{place}")
    for name, why in result.skipped.items():
        show(f"not checked: {name} ({why})", style=STYLES["note"])
    show("")


CHECK = Command.of(_check.__doc__, _check, {**bag_options(robot=True), **JSON_OPTION})

TEST_OPTIONS: Options = {
    "bags BAG": (BAG, {"nargs": "*"}),
    "--log LOG": (
        "instead of bags: tables (CSV, plain or .gz, Parquet), each a recording; or their "
        "folder, if the mapping names the files",
        LIST,
    ),
    "--mapping FILE": "what the columns of the log mean",
    "outputs": TABLE_OUTPUTS,
    **replay_options(
        compare="temperature of the fixed friction that the model is compared with (default: the "
        "model's fallback temperature)",
        fixed=False,
    ),
}


def _test(args: Namespace) -> int:
    """`robot-energy test`: how good a model is on recordings: torque, shafts, power, energy.

    Compare a model with what was measured: torque of every motor, shaft energy, power and energy at
    the meter. The same model with friction at one temperature and a prediction of zero are compared
    in the same way. It says of each recording whether the model was identified from it: figures on
    such a recording are not held out, and say little of others.

    examples:
      robot-energy test cold warm --model my_robot.yaml --effort motor_torque
      robot-energy test bag --model kr16 --compare 60 --json test.json --report test.html
      robot-energy test --log log.csv --mapping cell.yaml --model my_robot.yaml
    """
    from robot_energy_report.formats import counted

    if bool(args.bags) == bool(args.log):
        raise ModelFileError("neither bags nor a log, or both", "BAG... or --log")
    if (args.log is None) != (args.mapping is None):
        raise ModelFileError("a log without its mapping, or the reverse", "--log and --mapping")
    named = model_named(args)
    given = [*args.bags, *(args.log or ()), named, args.inputs, args.mapping]
    check_outputs(args, given)
    keep_freed_memory()
    report = _of_logs(args, named) if args.log else _evaluated(args, args.bags, named)
    present(
        args,
        report,
        f"Test of {report.model.robot}",
        f"Model {report.model.model_id} on {counted(len(report.recordings), 'recording')}.",
    )
    return DAMAGED if any(one.problems for one in report.recordings) else 0


def _evaluated(
    args: Namespace, bags: list[Any], model: str, effort: str | None = None
) -> EvaluationReport:
    from robot_energy_identify.api.evaluate import evaluate

    options = options_given(args)
    options["effort"] = options["effort"] or effort
    compare = AT_FALLBACK if args.compare is None else args.compare
    with progress("testing") as show:
        return evaluate(bags, model, temperature=compare, progress=show, **options)


def _of_logs(args: Namespace, model: str) -> EvaluationReport:
    from robot_energy.foundation.files.temporary_folder import TemporaryFolder
    from robot_energy_identify.provenance import sha256_of
    from robot_energy_logs.log_import import import_log
    from robot_energy_logs.mapping import load_mapping

    mapping = load_mapping(args.mapping)
    effort = mapping.joints.effort
    meaning = None
    if effort is not None and effort.side is not None:
        current = effort.si_unit == "ampere"
        meaning = f"{effort.side}_{'current' if current else 'torque'}"
    with TemporaryFolder() as folder:
        bags = [
            import_log(log, mapping, folder.path / str(number) / Path(log).name).bag
            for number, log in enumerate(args.log)
        ]
        report = _evaluated(args, bags, model, meaning)
    hashes = [sha256_of(Path(log)) for log in args.log]
    recordings = [
        replace(one, sha256=sha256) for one, sha256 in zip(report.recordings, hashes, strict=True)
    ]
    return replace(report, recordings=tuple(recordings))


TEST = Command.of(_test.__doc__, _test, TEST_OPTIONS)


def _import_of(kind: LogFormat) -> Command:
    def options(parser: ArgumentParser) -> None:
        kind.add_arguments(parser)
        add_option(parser, "--out BAG", "folder of the new bag", required=True)
        add_option(parser, "--overwrite", "replace the bag of --out")

    def run(args: Namespace) -> int:
        _print_import(kind.run(args))
        return 0

    return Command(kind.name, kind.line, run, options, kind.description, kind.epilog)


def _print_import(report: ImportReport) -> None:
    out = console()
    start, end = report.start_ns or 0, report.end_ns or 0
    rate = (report.joint_states - 1) / ((end - start) * 1e-9)
    span = f"{(end - start) * 1e-9:.3f} s, {rate:.4g} joint states a second on average"
    wrote(out, report.bag, span)
    topics = [
        (JOINT_STATES_TOPIC, report.joint_states),
        (TEMPERATURES_TOPIC, report.temperatures),
        (METER_TOPIC, report.readings),
        ("/drive_power", report.drive_powers),
        ("/energy/payload", report.payloads),
    ]
    for topic, count in topics:
        out.print(f"  {topic:<20} {count or 'none'}")
    for account in report.files:
        reasons = ", ".join(
            f"{count} {reason.replace('_', ' ')} (first at line {account.first_line[reason]}"
            f"{account.offending(reason)})"
            for reason, count in account.rejected.items()
        )
        out.print(
            f"{account.path}: {account.received} rows, {account.accepted} used, "
            f"rejected: {reasons or 'none'}"
        )
    for note in report.notes:
        out.print(f"note: {note}")


IMPORT = Group(
    "import",
    "turn logs (UR RTDE, CSV, Parquet) into bags",
    "Convert logs of robots to bags that replay like others. Rows that "
    "cannot be used are counted by reason and reported.",
    "kinds of logs",
    "KIND",
    lambda: map(_import_of, LOG_FORMATS.values()),
)
