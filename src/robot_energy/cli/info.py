"""`robot-energy info`: what a bag holds."""

from __future__ import annotations

from argparse import Namespace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from robot_energy.cli.terminal import add_command, console

if TYPE_CHECKING:
    from robot_energy.bag import BagReader

DAMAGED = 3


def add_parser(commands: Any) -> None:
    """Add the sub-command.

    Args:
        commands: What `ArgumentParser.add_subparsers` returned.
    """
    text = "topics, types, counts and time span of a bag"
    description = "Print the topics of a bag and what replay can use them for."
    parser = add_command(commands, "info", run, text, description)
    parser.add_argument("bag", help="MCAP file, or rosbag2 folder")


def run(args: Namespace) -> int:
    """Print what a bag holds.

    Args:
        args: Of the sub-command.

    Returns:
        0, or 3 if the bag is damaged.

    Raises:
        BagError: If it cannot be read.
    """
    from robot_energy.bag import BagReader
    from robot_energy.report.document import Document
    from robot_energy.report.model import bag_document
    from robot_energy.report.printing import print_document

    bag = BagReader(args.bag)
    counts: dict[str, int | None] = {name: info.message_count for name, info in bag.topics.items()}
    start, end = bag.start_ns, bag.end_ns
    if None in counts.values() or start is None:
        counts, start, end = _read(bag, counts)
    span = None
    if start is not None and end is not None:
        first = datetime.fromtimestamp(start // 10**9, tz=UTC)
        span = f"from {first:%Y-%m-%d %H:%M:%S} UTC, {(end - start) * 1e-9:.3f} s"
    rows = [
        (name, info.msgtype, "?" if counts[name] is None else str(counts[name]), _use(info.msgtype))
        for name, info in bag.topics.items()
    ]
    page = Document()
    bag_document(str(args.bag), span, rows, bag.problems, bag.origin, page)
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
    """Count by reading, where the bag does not say."""
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
