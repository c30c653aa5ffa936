"""What the commands under `robot-energy identify` share: bags to read, results to write."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robot_energy.foundation.errors import ModelFileError
from robot_energy_cli.command import LIST, Options, number
from robot_energy_cli.replay_arguments import INPUTS, MODEL_OR_ROBOT
from robot_energy_cli.terminal import TABLE_OUTPUTS, check_outputs, progress
from robot_energy_identify.options import EFFORTS

if TYPE_CHECKING:
    from robot_energy_identify.api.bag_source import BagSource
    from robot_energy_identify.drives.drive_power import DrivePowerTopics
    from robot_energy_identify.stats.systematic import SensorLimits
    from robot_energy_logs.recording import LogBlock

SENSORS = (  # option, its unit, field of `SensorLimits`, default, what it limits
    ("meter-class", "PERCENT", "meter", 1.0, "gain of the power meter: its class"),
    ("torque-tolerance", "PERCENT", "torque", 5.0,
     "torque constant of each motor, or gain of the torque"),
    ("thermometer-tolerance", "K", "thermometer", 2.0, "motor temperatures"),
    ("body-tolerance", "PERCENT", "bodies", 5.0, "torque of bodies that are not identified"),
    ("drive-power-class", "PERCENT", "drive_power", 2.0,
     "gain of the power that each drive reports"),
)  # fmt: skip
SENSOR_OPTIONS: Options = {  # which no recording shows
    "limits of constant errors, from data sheets, +-": {
        f"--{name} {unit}": f"{what} [{unit.replace('PERCENT', '%%')}] (default: {default:g})"
        for name, unit, _, default, what in SENSORS
    }
}
LINK_VOLTAGES: Options = {  # which a grid meter cannot determine
    "--link-voltages": (
        "of the DC link: rectified mains, and where the brake chopper starts [V] (default: "
        "those of the model file, else 566 and 700, assumed)",
        {"nargs": 2, "type": number, "metavar": ("MAINS", "CHOPPER")},
    )
}
LOG: Options = {
    "--log LOG": ("tables: CSV, plain or .gz, Parquet", LIST),
    "--mapping FILE": "what its columns mean",
}


def bag_options(
    required: bool = True,
    effort: str = "what the effort in the joint states means",
    robot: bool = False,
) -> Options:
    """Return recordings, model and what their topics mean."""
    model: Options = {"--model FILE|NAME": ("model file to begin with", {"required": required})}
    meaning = (f"%(choices)s: {effort}", {"choices": EFFORTS})
    return {
        "bags BAG": ("recordings of one robot", {"nargs": "+" if required else "*"}),
        **(MODEL_OR_ROBOT if robot else model),
        **({"--effort MEANING": meaning} if effort else {}),
        **INPUTS,
    }


def result_options(what: str, plot: str = "") -> Options:
    """Return what can be written."""
    figure = {"--plot FILE": plot} if plot else {}
    return {"--out FILE": f"write the model with {what}", **TABLE_OUTPUTS, **figure}


class IdentifyInputs:
    """What was typed of recordings, logs and files to write, with that of the options above.

    Attributes:
        log_notes: What was found and assumed about a log, and rows that were not used.
    """

    def __init__(self, args: Namespace) -> None:
        self.args = args
        self.log_notes: list[str] = []

    def drive_power(self) -> DrivePowerTopics | None:
        """Return where the bags have the power of each drive; None without `--drive-power`."""
        from robot_energy_identify.drives.drive_power import drive_topics

        if not self.args.drive_power and (self.args.drive_joints or self.args.dq_scaling != "peak"):
            option = "--drive-joints" if self.args.drive_joints else "--dq-scaling"
            raise ModelFileError(f"{option} without --drive-power", "both or none")
        return drive_topics(self.args.drive_power, self.args.drive_joints, self.args.dq_scaling)

    def sensor_limits(self) -> SensorLimits:
        """Return the limits of the constant errors of the sensors."""
        from robot_energy_identify.stats.systematic import SensorLimits

        given: dict[str, float] = {}
        for name, unit, field, *_ in SENSORS:
            value = getattr(self.args, name.replace("-", "_"))
            if value is not None:
                given[field] = value / 100.0 if unit == "PERCENT" else value
        return SensorLimits(**given)

    def link_voltages(self) -> tuple[float, float] | None:
        """Return rectified mains and start of the brake chopper [V]; None if not given."""
        if self.args.link_voltages is None:
            return None
        low, high = self.args.link_voltages
        if not 0.0 < low < high < float("inf"):
            raise ModelFileError(
                f"--link-voltages are {low:g} and {high:g} V",
                "rectified mains above 0, then the higher voltage of the chopper",
            )
        return low, high

    def check_results(self) -> None:
        """Refuse files that cannot be written, before the work."""
        inputs: list[Any] = []
        for name in ("bags", "test", "log", "model", "inputs", "mapping"):
            value = getattr(self.args, name, None)
            inputs += value if isinstance(value, list) else [value]
        check_outputs(self.args, [one for one in inputs if isinstance(one, str)], self.args.out)

    def check_source(self, needs_effort: bool = False, relative: str = "") -> None:
        """Refuse bags together with logs, without what they need, or one recording twice.

        ``relative`` says why a log, which needs its mapping, makes no model file.
        """
        from robot_energy_identify.provenance import require_distinct

        args = self.args
        if bool(args.bags) == bool(args.log):
            raise ModelFileError("neither bags nor a log, or both", "BAG... or --log")
        if args.bags:
            if needs_effort and (None in (args.model, args.effort or args.inputs)):
                raise ModelFileError(
                    "bags need --model and --effort",
                    f"a model file, and one of {', '.join(EFFORTS)}",
                    "the effort of a driver is never guessed",
                )
            if args.model is None:
                raise ModelFileError("bags need --model", "a model file")
        require_distinct([Path(name) for name in args.bags or args.log])
        if args.log and relative:
            if args.mapping is None:
                raise ModelFileError(
                    "the log has no --mapping", "a YAML file that names its columns"
                )
            if args.out is not None:
                raise ModelFileError(relative, "bags with --model", "import the log to a bag")

    def columns_of_log(self) -> tuple[list[LogBlock], list[str]]:
        """Return the columns of the tables, one entry for each, and the names of the joints."""
        from robot_energy_logs.log_import import open_logs
        from robot_energy_logs.mapping import load_mapping
        from robot_energy_logs.rows import Clock

        mapping = load_mapping(self.args.mapping)
        clock = Clock(mapping.time)
        logs = open_logs(self.args.log, mapping)
        blocks = [log.whole(clock) for log in logs]
        for log in logs:
            self.log_notes += log.notes
            if log.account.rejected:
                self.log_notes.append(
                    f"{log.account.accepted} of {log.account.received} rows of {log.name} are "
                    f"used ({log.account.reasons})"
                )
        self.log_notes += clock.notes
        return blocks, mapping.joints.names

    def bags(self, bags: Sequence[str | Path] | None = None) -> BagSource:
        """Return the recordings, and how they are read."""
        from robot_energy_identify.api.bag_source import BagSource

        effort, robot = getattr(self.args, "effort", None), getattr(self.args, "robot", None)
        sensors = self.sensor_limits() if hasattr(self.args, "meter_class") else None
        used = self.args.bags if bags is None else bags
        return BagSource(used, effort, self.args.inputs, robot, progress, sensors)

    def names(self) -> str:
        """Return the names of the recordings, for the model file."""
        return ", ".join(Path(name).name for name in self.args.bags or self.args.log)
