"""The command `robot-energy export`: power over time as a table."""

from __future__ import annotations

from argparse import Namespace

from robot_energy.foundation.errors import ReportError
from robot_energy.foundation.extras import require
from robot_energy.foundation.files.output_files import (
    CSV,
    PARQUET,
    FileKind,
    check_file,
    write_file,
)
from robot_energy.foundation.process_memory import keep_freed_memory
from robot_energy.foundation.shown_text import shown
from robot_energy_cli.command import REQUIRED, Command, Options
from robot_energy_cli.replay_arguments import (
    BAG,
    DAMAGED,
    model_named,
    options_given,
    replay_options,
)
from robot_energy_cli.terminal import console, progress, wrote

WHAT = "the table"
KINDS: dict[str, tuple[FileKind, ...]] = {".csv": CSV, ".parquet": PARQUET}


OPTIONS: Options = {
    "bag": BAG,
    "--out FILE": ("the table: .csv, or .parquet (needs polars)", REQUIRED),
    **replay_options("write means over periods of this length (default: every sample)"),
}


def _run(args: Namespace) -> int:
    """`robot-energy export`: the power of a recorded bag over time, as CSV or Parquet.

    Run a recorded bag through the model of its robot and write its power over time: one row per
    sample or per period, with predicted, measured and residual power, every loss, phase and
    quality, and the same per joint. Units are those of the nomenclature: W, N m, rad/s, degC.

    examples:
      robot-energy export bag --model kr16 --out power.csv
      robot-energy export bag --model kr16 --power-period 0.1 --out power.parquet
    """
    from robot_energy.replay.api import replay

    suffix = next((end for end in KINDS if args.out.lower().endswith(end)), None)
    if suffix is None:
        raise ReportError(
            f"'{shown(args.out)}' is not a table of a known kind",
            f"a name with {' or '.join(KINDS)}",
        )
    model = model_named(args)
    inputs = [name for name in (args.bag, model, args.inputs) if name]
    check_file(args.out, KINDS[suffix], WHAT, inputs)
    if suffix == ".parquet":
        require("polars", "Parquet")
    keep_freed_memory()
    with progress("replaying") as report:
        result = replay(
            args.bag,
            model,
            temperature=args.fixed_friction,
            progress=report,
            **options_given(args),
        )
    table = result.power
    data = table.to_csv().encode() if suffix == ".csv" else table.to_parquet()
    write_file(args.out, data, KINDS[suffix], WHAT)
    out = console()
    for sentence in (*result.problems, *result.notes):
        out.print(sentence)
    wrote(out, args.out, f"{len(result.power)} rows")
    return DAMAGED if result.replay.problems else 0


COMMAND = Command.of(_run.__doc__, _run, OPTIONS)
