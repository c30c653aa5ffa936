"""`robot-energy test`: how good a model is on recordings: torque, shafts, power and metered energy.

Compare a model with what was measured: torque of every motor, shaft energy, power and energy at
the meter. The same model with friction at one temperature and a prediction of zero are compared
in the same way. It says of each recording whether the model was identified from it: figures on
such a recording are not held out, and say little of others.

examples:
  robot-energy test cold warm --model my_robot.yaml --effort motor_torque
  robot-energy test bag --model kr16 --compare 60 --json test.json --report test.html
  robot-energy test --log log.csv --mapping cell.yaml --model my_robot.yaml
"""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robot_energy.foundation.errors import ModelFileError
from robot_energy.foundation.process_memory import keep_freed_memory
from robot_energy_cli.command import LIST, Command, Options
from robot_energy_cli.replay_arguments import (
    AT_FALLBACK,
    BAG,
    DAMAGED,
    model_named,
    options_given,
    replay_options,
)
from robot_energy_cli.terminal import TABLE_OUTPUTS, check_outputs, present, progress

if TYPE_CHECKING:
    from robot_energy_identify.results.evaluation import EvaluationReport


OPTIONS: Options = {
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


def _run(args: Namespace) -> int:
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


COMMAND = Command.of(__doc__, _run, OPTIONS)
