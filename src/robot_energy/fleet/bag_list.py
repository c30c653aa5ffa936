"""The bags of a fleet: found in a folder, by a pattern or in a CSV table, on any file system.

Addresses are those of fsspec: a local path, or a URL such as ``s3://recordings/2026``.
"""

from __future__ import annotations

import csv
import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any, cast

from fsspec.core import url_to_fs  # type: ignore[import-untyped]

from robot_energy import __version__
from robot_energy.bag.mcap_records import MAGIC
from robot_energy.bag.metadata import FILE_NAME
from robot_energy.errors import DatasetError
from robot_energy.model import RobotModel, load
from robot_energy.recorded_jobs import load_jobs
from robot_energy.shown_text import shown

COLUMNS = ("bag", "model", "robot", "programme", "shift", "jobs", "effort")
MESSAGES = (".mcap", ".db3", ".zstd")  # endings of files with messages
CHANGED = ("ETag", "mtime", "LastModified", "last_modified", "updated", "created")
DIGITS = 16  # of a hash in a name
UNREAD = "unread"  # instead of the state of a bag that is to be tried again

Infos = dict[str, dict[str, Any]]


def digest(*parts: object) -> str:
    """Return a short hash of plain values.

    Args:
        *parts: The values.
    """
    text = json.dumps(parts, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:DIGITS]


@dataclass(frozen=True)
class BagPlace:
    """Where a bag is.

    Attributes:
        address: Local path, or URL.
        files: Addresses of its files with messages and metadata; none if it is not there.
        sizes: Of these files. [bytes]
        state: Hash of their sizes and times of change.
        is_folder: Whether it is a folder of rosbag2.
        is_local: Whether it can be read where it is.
    """

    address: str
    files: tuple[str, ...]
    sizes: tuple[int, ...]
    state: str
    is_folder: bool
    is_local: bool

    @property
    def size(self) -> int:
        """Of all files. [bytes]"""
        return sum(self.sizes)


@dataclass(frozen=True)
class FleetBag:
    """A bag to replay, with all that a worker needs but the model.

    Attributes:
        place: Where it is.
        robot: Name of its robot in the fleet.
        programme: What the robot did; may be empty.
        shift: When; may be empty.
        model: File or name of its model.
        options: Of the replay, plain values under the names of `ReplayOptions`.
        texts: Text of files among the options, by option: workers need not have the files.
        model_digest: Hash of the model.
        version: Of this tool.
        named: Addresses under which a table names it.
    """

    place: BagPlace
    robot: str
    programme: str = ""
    shift: str = ""
    model: str = ""
    options: Mapping[str, Any] = field(default_factory=dict[str, Any])
    texts: Mapping[str, str] = field(default_factory=dict[str, str])
    model_digest: str = ""
    version: str = __version__
    named: tuple[str, ...] = ()

    @cached_property
    def settings(self) -> str:
        """Hash of model, options, version and what the list of bags says of the bag."""
        words = (self.robot, self.programme, self.shift, self.version)
        return digest(*words, self.model_digest, dict(self.options), dict(self.texts))

    @cached_property
    def name(self) -> str:
        """Of its file in the dataset, and of its task."""
        return f"{digest(self.place.address)}-{self.place.state}-{self.settings}"

    @property
    def parts(self) -> list[tuple[str, str]]:
        """Robots and addresses that its files have as bags of their own."""
        return self._elsewhere(self.place.files)

    @property
    def missed(self) -> list[tuple[str, str]]:
        """Robots and addresses that it has where it is not found."""
        return self._elsewhere(self.named)

    def _elsewhere(self, addresses: Iterable[str]) -> list[tuple[str, str]]:
        return [
            (robot, address)
            for address in addresses
            if address != self.place.address
            for robot in (self.robot, _robot_of(address, is_folder=False))
        ]

    @property
    def unread_name(self) -> str:
        """Of its file if it cannot be read, which the next run tries again."""
        return f"{digest(self.place.address)}-{UNREAD}-{self.settings}"


class FleetModels:
    """The models of a fleet, each read once.

    Attributes:
        models: By their hashes.
    """

    def __init__(self) -> None:
        self.models: dict[str, RobotModel] = {}
        self._digests: dict[str, str] = {}

    def digest_of(self, name: str) -> str:
        """Read a model and return its hash.

        Args:
            name: Model file, or name of a shipped model.

        Returns:
            The hash, by which `models` has the model.

        Raises:
            ModelFileError: If it cannot be used.
        """
        if name not in self._digests:
            self.add(load(name), name)
        return self._digests[name]

    def add(self, model: RobotModel, name: str = "") -> str:
        """Keep a model.

        Args:
            model: The model.
            name: Under which `digest_of` finds it; empty for that of its file.

        Returns:
            The name.
        """
        name = name or model.source
        late = {"auxiliary"} if model.auxiliary is None else None  # as before there was one
        own = digest(model.model_dump(mode="json", exclude=late), model.urdf_xml)
        self._digests[name] = own
        self.models[own] = model
        return name


def find_bags(where: str, split: bool = False, complete: bool = False) -> Iterator[BagPlace]:
    """Find bags.

    A folder with a metadata.yaml is a bag, and so is one whose MCAP files have its name and a
    number, as rosbag2 names them: a recording that is not closed yet, or never was. Elsewhere, and
    where files are named themselves, each MCAP file is.

    Args:
        where: Folder, pattern with ``*``, or one bag.
        split: Whether each MCAP file is a bag of its own in folders of rosbag2 too.
        complete: Whether to leave out what is still being written: folders without metadata,
            MCAP files without their end.

    Yields:
        In order of their addresses.

    Raises:
        DatasetError: If the place cannot be read.
    """
    try:
        system, root = cast("tuple[Any, str]", url_to_fs(where))
        roots = cast("list[str]", system.glob(root) if "*" in root else [root])
        infos: Infos = {}
        for one in roots:
            infos |= cast("Infos", system.find(one, detail=True))
    except (OSError, ValueError, ImportError) as error:
        raise DatasetError(
            f"{where} cannot be read ({error})", "a folder, pattern or bag"
        ) from error
    named = set(roots)
    folders: dict[str, list[str]] = {}
    for path in sorted(infos):
        folders.setdefault(str(PurePosixPath(path).parent), []).append(path)
    for folder, paths in sorted(folders.items()):
        messages = [path for path in paths if path.endswith(MESSAGES)]
        metadata = f"{folder}/{FILE_NAME}"
        mcap = [path for path in messages if path.endswith(".mcap")]
        unclosed = all(_of_folder(path) and path not in named for path in mcap)
        if messages and (metadata in paths or unclosed) and not (split and mcap):
            if not complete or (metadata in paths and infos[metadata].get("size")):
                yield _place(system, folder, infos, [*messages, metadata])
            continue
        for path in mcap:
            if not complete or _has_end(system, path, infos[path]):
                yield _place(system, path, infos, [path])


def _of_folder(path: str) -> bool:
    """Whether an MCAP file has the name of its folder and a number."""
    *_, folder, file = ("", *filter(None, path.split("/")))
    name, _, number = file.removesuffix(".mcap").rpartition("_")
    return name == folder and number.isdecimal() and file.endswith(".mcap")


def _place(system: Any, address: str, infos: Infos, files: list[str]) -> BagPlace:
    own = [(path, infos[path]) for path in files if path in infos]
    state = digest(
        [
            (PurePosixPath(path).name, info.get("size"), [str(info.get(key)) for key in CHANGED])
            for path, info in own
        ]
    )
    is_local = _is_local(system)
    named = address if is_local else str(system.unstrip_protocol(address))
    places = [path if is_local else str(system.unstrip_protocol(path)) for path, _ in own]
    sizes = tuple(int(info.get("size") or 0) for _, info in own)
    return BagPlace(named, tuple(places), sizes, state, address not in infos, is_local)


def _is_local(system: Any) -> bool:
    names = system.protocol
    return "file" in ((names,) if isinstance(names, str) else tuple(names))


def _has_end(system: Any, path: str, info: Mapping[str, Any]) -> bool:
    """Whether an MCAP file was closed by its writer."""
    size = int(info.get("size") or 0)
    if size <= 2 * len(MAGIC):
        return False
    return cast("bytes", system.cat_file(path, start=size - len(MAGIC))) == MAGIC


def list_bags(
    where: str,
    models: FleetModels,
    model: str | None,
    options: Mapping[str, Any],
    robot: str | None = None,
    split: bool = False,
    complete: bool = False,
) -> list[FleetBag]:
    """Return the bags of a fleet.

    Args:
        where: Folder, pattern, bag or CSV table.
        models: Where models are kept.
        model: File or name of the model of bags for which a table names none.
        options: Of the replay, for all bags.
        robot: Name of the robot of all bags; None: that of the folder in which a recording lies.
        split: As of `find_bags`.
        complete: As of `find_bags`.

    Returns:
        The bags.

    Raises:
        DatasetError: If place or table cannot be used.
        RobotEnergyError: If a model or a file of the options cannot be used.
    """
    given, texts = dict(options), dict[str, str]()
    for name in ("jobs", "inputs"):
        if path := given.pop(name, None):
            texts[name] = _text(name, Path(str(path)))
    base = FleetBag(BagPlace("", (), (), "", False, True), robot or "", model=model or "",
                    options={key: value for key, value in given.items() if value is not None},
                    texts=texts)  # fmt: skip
    if where.lower().endswith(".csv"):
        rows = list(_table(where, base, split, complete))
    else:
        rows = [replace(base, place=place) for place in find_bags(where, split, complete)]
    found: list[FleetBag] = []
    for bag in rows:
        if not bag.model:
            raise DatasetError(
                f"no model for {bag.place.address}", "--model, or a column 'model' of the table"
            )
        named = bag.robot or _robot_of(bag.place.address, bag.place.is_folder)
        found.append(replace(bag, robot=named, model_digest=models.digest_of(bag.model)))
    if not found and not complete:
        raise DatasetError(
            f"{where} holds no bag", "MCAP files or folders of rosbag2", "check the path"
        )
    return found


def _robot_of(address: str, is_folder: bool) -> str:
    """Name of the folder in which a recording lies, whether the bag is all of it or one file."""
    folder = PurePosixPath(address.rstrip("/")).parent
    is_part = not is_folder and _of_folder(address)
    return (folder.parent if is_part else folder).name or "robot"


def _text(name: str, path: Path) -> str:
    """Text of a file among the options; a list of jobs is checked first."""
    if name == "jobs":
        load_jobs(path)
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise DatasetError(f"{path} cannot be read ({error.strerror})", "a YAML file") from error


def _table(where: str, base: FleetBag, split: bool, complete: bool) -> Iterator[FleetBag]:
    """The rows of a CSV table; paths of bags start at its folder, others may."""
    try:
        system, path = cast("tuple[Any, str]", url_to_fs(where))
        text = cast("bytes", system.cat_file(path)).decode("utf-8-sig")
    except (OSError, ValueError, ImportError) as error:
        raise DatasetError(f"{where} cannot be read ({error})", "a CSV table in UTF-8") from error
    rows = csv.DictReader(text.splitlines(), restkey="", restval="")
    unknown = [name for name in rows.fieldnames or [] if name not in COLUMNS]
    if unknown or "bag" not in (rows.fieldnames or []):
        found = f"has the column '{shown(unknown[0])}'" if unknown else "has no column 'bag'"
        raise DatasetError(f"{where} {found}", f"columns of {', '.join(COLUMNS)}; bag is needed")
    folder = Path(where).parent
    for number, row in enumerate(rows, start=2):
        if row.get("") or not row["bag"]:
            raise DatasetError(
                f"line {number} of {where} has {'too many cells' if row.get('') else 'no bag'}",
                "one cell for each column",
            )
        texts, options = dict(base.texts), dict(base.options)
        if row.get("jobs"):
            texts["jobs"] = _text("jobs", Path(_near(folder, row["jobs"])))
        if row.get("effort"):
            options["effort"] = row["effort"]
        named = row.get("model") or base.model
        own = replace(
            base,
            robot=row.get("robot") or base.robot,
            programme=row.get("programme") or "",
            shift=row.get("shift") or "",
            model=_near(folder, named),
            options=options,
            texts=texts,
        )
        path = _from(where, row["bag"])
        places = list(find_bags(path, split, complete))
        address = _address(path)
        own = replace(own, named=(address, row["bag"]))
        if not places and not complete:  # a row of the dataset will say so
            places = [BagPlace(address, (), (), UNREAD, False, True)]
        for place in places:
            yield replace(own, place=place)


def _from(table: str, name: str) -> str:
    """A path that starts at the folder of the table."""
    if "://" in table and "://" not in name and not name.startswith("/"):
        return f"{table.rpartition('/')[0]}/{name}"
    return name if "://" in name else str(Path(table).parent / Path(name).expanduser())


def _address(path: str) -> str:
    """As `find_bags` gives it."""
    system, found = cast("tuple[Any, str]", url_to_fs(path))
    return found if _is_local(system) else str(system.unstrip_protocol(found))


def _near(folder: Path, name: str) -> str:
    """A path that starts at the folder of the table, if it is there; else as it stands."""
    return str(folder / name) if name and "://" not in name and (folder / name).exists() else name
