"""Read recorded bags in constant memory: MCAP files and rosbag2 folders."""

from __future__ import annotations

import filecmp
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np

from robot_energy.bag.cdr.decode import RawBatch
from robot_energy.bag.cdr.types import extended, typestore
from robot_energy.bag.mcap_records import LogTimes
from robot_energy.bag.metadata import FILE_NAME, FolderInfo, read_folder_info
from robot_energy.bag.packed import Source, open_file, unpacked_file, unpacked_parts
from robot_energy.bag.sources import BagContents, TopicInfo
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import BagError, MissingTopicError
from robot_energy.foundation.units import SECOND_NS
from robot_energy.timeline.blocks import NANOSECOND

if TYPE_CHECKING:
    from robot_energy.bag.cdr.lazy_store import LazyStore


class TimeRange(Described):
    """From where to where a bag is read."""

    start: Annotated[
        float | None,
        "After the first message; negative: before the last one; None: from the first. [s]",
    ] = None
    end: Annotated[float | None, "Likewise; None: to the last. [s]"] = None

    def __bool__(self) -> bool:
        return self.start is not None or self.end is not None

    def span(self, bag: BagReader) -> LogTimes:
        """Return the log times of the part, both included. [ns]"""
        first, last = bag.start_ns, bag.end_ns
        if first is None or last is None:
            raise BagError(
                f"{bag.path} holds no message with a time, so no part of it can be named",
                remedy="leave out start and end",
            )

        def at(seconds: float | None, default: int) -> int:
            if seconds is None:
                return default
            return round(seconds / NANOSECOND) + (last if seconds < 0.0 else first)

        start, end = at(self.start, first), at(self.end, last)
        if start >= end or start >= last or end <= first:
            length = (last - first) * NANOSECOND
            raise BagError(
                f"nothing of {bag.path} lies from {(start - first) * NANOSECOND:g} to "
                f"{(end - first) * NANOSECOND:g} s after its start",
                f"a start before the end, both within its {length:g} s",
                "change start and end; negative ones count from the end of the bag",
            )
        return max(start, first), min(end, last)

    def sentence(self, bag: BagReader) -> str:
        start, end = (((at - (bag.start_ns or 0)) * NANOSECOND) for at in self.span(bag))
        whole = ((bag.end_ns or 0) - (bag.start_ns or 0)) * NANOSECOND
        return f"only a part of the bag was read: from {start:.6g} to {end:.6g} s of {whole:.6g} s"


MAX_OVERLAP_NS = SECOND_NS
"""By which chunks and files of a bag may overlap: several publishers are not in step. [ns]"""

MAX_PROBLEMS = 100  # sentences about what is wrong that are kept
_BY_HAND = "save the values as CSV, and import that with `robot-energy import table`"
CONVERSIONS = {
    "json": f"read them with the Python package `mcap`, {_BY_HAND}",
    "ros1": "convert the ROS 1 bag that they come from: "
    "`rosbags-convert --src FILE.bag --dst FOLDER`",
    "": f"read them with the library that wrote them, {_BY_HAND}",
}
"""How to use messages that are not serialized as CDR, by their encoding; "" for any other."""


class BagReader:
    """Reads one bag: an MCAP file, or a rosbag2 folder with MCAP or sqlite3 files.

    Damage found on the way does not raise: what is whole is delivered, and ``problems`` says what
    was not.

    Attributes:
        start_ns: Earliest log time; None if unknown or the bag is empty. [ns]
        end_ns: Latest log time; None if unknown or the bag is empty. [ns]
        message_count: Messages in the bag; None if it does not say.
        origin: Where the recording comes from, as its writer said; empty if it did not.
        problems: What was found wrong so far, one sentence each.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.problems: list[str] = []
        self.origin = ""
        self._said_count: int | None = None  # of metadata.yaml
        self._packed = False  # message by message
        self._sources = self._find()
        contents = BagContents()
        spans: list[tuple[int, int, frozenset[str]]] = []
        for source in self._sources:
            part = source.contents()
            contents.add(part, self._report)
            if part.span is not None:
                spans.append((*part.span, frozenset(part.topics)))
        files_overlap = self._check_spans(spans)
        self._scattered = max(files_overlap, contents.overlap_ns) > MAX_OVERLAP_NS
        if None not in (self._said_count, contents.message_count) and (
            self._said_count != contents.message_count
        ):
            self._report(
                f"{FILE_NAME} counts {self._said_count} messages where the files hold "
                f"{contents.message_count}"
            )
        self._definitions = contents.definitions
        self.topics: dict[str, TopicInfo] = dict(sorted(contents.topics.items()))
        self.start_ns, self.end_ns = contents.span or (None, None)
        self.message_count = contents.message_count

    @cached_property
    def typestore(self) -> LazyStore:
        """Message definitions for this bag: the known ones, and the bag's own where they differ."""
        return extended(typestore(), self._definitions, self._report)

    @property
    def unverified_count(self) -> int:
        """Messages delivered so far that no checksum in the bag covers."""
        return sum(source.unverified_count for source in self._sources)

    def require(self, topic: str, msgtypes: str | Collection[str]) -> TopicInfo:
        accepted = [msgtypes] if isinstance(msgtypes, str) else list(msgtypes)
        info = self.topics.get(topic)
        if info and info.msgtype in accepted and info.encoding == "cdr":
            return info
        other = {(kind, "cdr") for kind in accepted}
        fitting = [n for n, each in self.topics.items() if (each.msgtype, each.encoding) in other]
        have = f"has {topic} as {info.msgtype} ({info.encoding})" if info else f"has no {topic}"
        remedy = "the bag has no topic of that type"
        if fitting:
            remedy = f"topics of that type in the bag: {', '.join(fitting)}"
        elif info and info.msgtype in accepted:
            remedy = CONVERSIONS.get(info.encoding, CONVERSIONS[""])
        expected = f"type {' or '.join(accepted)}, encoded as cdr"
        raise MissingTopicError(f"{self.path} {have}", expected, remedy)

    def parts(
        self, topics: Collection[str], spans: Mapping[str, LogTimes] | None = None
    ) -> Iterator[dict[str, RawBatch]]:
        """Yield the messages of some topics in file order, one batch a topic; never an empty part.

        Each part holds one chunk of the bag, or at most 8192 messages. Inside a batch the order
        is by log time, equal times in file order; from part to part log times may step back.
        Topics that lie one behind the other in the bag are brought together by their log times.
        Where the log times of a topic jump back and forth, it is the order in the file, and the
        problem is reported.
        """
        if absent := [name for name in topics if name not in self.topics]:
            raise MissingTopicError(
                f"{self.path} has no {absent[0]}", f"one of {', '.join(self.topics) or 'none'}"
            )
        wanted = {name: self.topics[name].msgtype for name in topics}
        for name, msgtype in wanted.items():
            self.require(name, msgtype)
        spans = spans or {}
        if not self._scattered or len(wanted) < 2:
            return self._in_file_order(wanted, spans)
        if not all(rises(self._one(topic, kind, spans)) for topic, kind in wanted.items()):
            return self._in_file_order(wanted, spans)
        return merged([self._one(topic, kind, spans) for topic, kind in wanted.items()])

    def _one(self, topic: str, msgtype: str, spans: Mapping[str, LogTimes]) -> Iterator[RawBatch]:
        return (part[topic] for part in self._in_file_order({topic: msgtype}, spans))

    def _in_file_order(
        self, wanted: dict[str, str], spans: Mapping[str, LogTimes]
    ) -> Iterator[dict[str, RawBatch]]:
        for source in self._sources if wanted else ():
            parts = source.parts(wanted, spans)
            for part in unpacked_parts(parts, self._report) if self._packed else parts:
                for topic in part.keys() & spans.keys():
                    times, (first, last) = part[topic].log_time_ns, spans[topic]
                    inside = (times >= first) & (times <= last)
                    if not inside.all():
                        part[topic] = part[topic][np.flatnonzero(inside)]
                if within := {topic: batch for topic, batch in part.items() if len(batch)}:
                    yield within

    def _report(self, sentence: str) -> None:
        if len(self.problems) <= MAX_PROBLEMS and sentence not in self.problems:
            more = len(self.problems) == MAX_PROBLEMS
            self.problems.append("there is more of this kind" if more else sentence)

    def _find(self) -> list[Source]:
        if not self.path.exists():
            raise BagError(f"{self.path} does not exist", "an MCAP file or a rosbag2 folder")
        if not self.path.is_dir():
            return [open_file(self.path, self._report)]
        if (self.path / FILE_NAME).exists():
            try:
                info = read_folder_info(self.path)
            except BagError as error:
                self._report(str(error))
            else:
                if listed := self._listed(info):
                    return listed
        for pattern in ("*.mcap", "*.db3"):
            listed = sorted(self.path.glob(pattern), key=_natural)
            found = self._distinct([file for file in listed if file.is_file()])
            if found:
                return [open_file(file, self._report) for file in found]
        for file in sorted(self.path.glob("*.bag")):  # of ROS 1, which says what to do
            open_file(file, self._report)
        bags = {file.parent for end in ("mcap", "db3") for file in self.path.glob(f"*/*.{end}")}
        raise BagError(
            f"{self.path} holds no bag",
            "a folder with .mcap or .db3 files",
            f"name one in it, such as {min(bags)}; `robot-energy fleet run` takes all"
            if bags
            else "check the path",
        )

    def _listed(self, info: FolderInfo) -> list[Source]:
        """Return the files that the metadata lists, as far as they are there."""
        self.origin = info.origin
        files = [self.path / name for name in info.files]
        for missing in [file for file in files if not file.is_file()]:
            self._report(f"{missing.name} is in {FILE_NAME} but not in the folder")
        present = self._distinct([file for file in files if file.is_file()])
        if len(present) == len(files):
            self._said_count = info.message_count
        if info.compression_mode == "file":
            return [unpacked_file(file, self._report) for file in present]
        self._packed = info.compression_mode == "message"
        return [open_file(file, self._report) for file in present]

    def _distinct(self, files: Sequence[Path]) -> list[Path]:
        """Return the files without those of the same content as one before."""
        kept: list[Path] = []
        sizes: dict[int, list[Path]] = {}
        for file in files:
            like = sizes.setdefault(file.stat().st_size, [])
            same = next((one for one in like if _same_content(file, one)), None)
            if same is None:
                kept.append(file)
                like.append(file)
            elif same.name == file.name:
                self._report(f"{file.name} is listed several times in {FILE_NAME}; read once")
            else:
                self._report(f"{file.name} is the same as {same.name}; it was left out")
        return kept

    def _check_spans(self, spans: Sequence[tuple[int, int, frozenset[str]]]) -> int:
        """Report files with a topic in common at the same time; return the longest overlap [ns]."""
        most = same = latest = 0
        ends: dict[str, int] = {}
        for start, end, topics in sorted(spans, key=lambda span: span[:2]):
            most = max(most, min(latest, end) - start)
            same = max(same, *(min(ends.get(topic, 0), end) - start for topic in topics), 0)
            latest = max(latest, end)
            ends |= {topic: max(ends.get(topic, 0), end) for topic in topics}
        if same > MAX_OVERLAP_NS:
            self._report(
                f"files of the bag overlap by {same * 1e-9:.3f} s; what is in both counts twice"
            )
        return most


def _same_content(first: Path, second: Path) -> bool:
    try:
        return first.samefile(second) or filecmp.cmp(first, second, shallow=False)
    except OSError:  # whoever reads it says why
        return False


def _natural(path: Path) -> list[tuple[int, str]]:
    """Sort key that puts ``bag_10`` after ``bag_9``."""
    return [(int(part or 0), text) for text, part in re.findall(r"(\D*)(\d*)", path.name)]


def rises(batches: Iterable[RawBatch]) -> bool:
    """Return whether the log times of a topic order its messages."""
    newest: int | None = None
    for batch in batches:
        times = batch.log_time_ns
        if bool((np.diff(times) < 0).any()):
            return False
        if newest is not None and int(times[0]) < newest - MAX_OVERLAP_NS:
            return False
        newest = int(times[-1])
    return True


def merged(topics: Sequence[Iterator[RawBatch]]) -> Iterator[dict[str, RawBatch]]:
    """Yield messages of topics whose log times rise, none ahead of another by more than a batch."""
    held: list[RawBatch | None] = [next(topic, None) for topic in topics]
    while ends := [int(batch.log_time_ns[-1]) for batch in held if batch is not None]:
        until = min(ends)
        part: dict[str, RawBatch] = {}
        for number, batch in enumerate(held):
            if batch is None:
                continue
            count = int(np.searchsorted(batch.log_time_ns, until, side="right"))
            if count:
                part[batch.topic] = batch[slice(count)]
            held[number] = (
                batch[slice(count, None)] if count < len(batch) else next(topics[number], None)
            )
        yield part
