"""`robot-energy info`: topics, types, counts and time span of a bag.

Print the topics of a bag and what replay can use them for.
"""

from __future__ import annotations

from argparse import Namespace
from typing import TYPE_CHECKING

from robot_energy_cli.command import Command
from robot_energy_cli.replay_arguments import DAMAGED
from robot_energy_cli.terminal import console

if TYPE_CHECKING:
    from robot_energy.bag import BagReader


def _run(args: Namespace) -> int:
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


COMMAND = Command.of(__doc__, _run, {"bag": "MCAP file, or rosbag2 folder"})
