"""The bags of a fleet, each with its robot and model: of a place, or of a CSV table."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import field, replace
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Annotated, Any
from urllib.parse import quote

from robot_energy import __version__
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import DatasetError, RobotEnergyError
from robot_energy.foundation.shown_text import shown
from robot_energy.model import RobotModel, load
from robot_energy.replay.recorded_jobs import load_jobs
from robot_energy_fleet.bag_places import (
    UNREAD,
    BagPlace,
    digest,
    file_system,
    find_bags,
    is_of_folder,
    named_on,
    no_bag,
    read_whole,
    unusable,
)

COLUMNS = ("bag", "model", "robot", "programme", "shift", "jobs", "effort")
MAX_NAME = 240  # characters of a robot's name in that of its folder, some of which need twelve
MAX_SHOWN = 40
SHORT = 20  # characters that always fit into it


class FleetBag(Described):
    """A bag to replay, with all that a worker needs but the model."""

    place: BagPlace
    robot: str
    programme: Annotated[str, "What the robot did; may be empty."] = ""
    shift: str = ""
    model: str = ""
    options: Annotated[
        Mapping[str, Any], "Of the replay, plain values under the names of `ReplayOptions`."
    ] = field(default_factory=dict[str, Any])
    texts: Annotated[
        Mapping[str, str],
        "Text of files among the options, by option: workers need not have the files.",
    ] = field(default_factory=dict[str, str])
    model_digest: str = ""
    version: str = __version__
    named: Annotated[tuple[str, ...], "Addresses under which a table names it."] = ()
    with_history: Annotated[bool, "Whether its registers at each minute are wanted, too."] = False

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
    """The models of a fleet, each read once."""

    def __init__(self) -> None:
        self.models: dict[str, RobotModel] = {}
        self._digests: dict[str, str] = {}

    def digest_of(self, name: str) -> str:
        """Return the hash of a model, by which `models` has it from now on."""
        if name not in self._digests:
            self.add(load(name), name)
        return self._digests[name]

    def add(self, model: RobotModel, name: str = "") -> str:
        """Return the name of a model that is kept from now on.

        Args:
            name: Under which `digest_of` finds it; empty for that of its file.
        """
        name = name or model.source
        late = {"auxiliary"} if model.auxiliary is None else None  # as before there was one
        own = digest(model.model_dump(mode="json", exclude=late), model.urdf_xml)
        self._digests[name] = own
        self.models[own] = model
        return name


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
        model: File or name of the model of bags for which a table names none.
        robot: Name of the robot of all bags; None: that of the folder in which a recording lies.
    """
    if robot and robot != shown(robot):
        raise DatasetError(f"the name of the robot is '{shown(robot)}'", "one of letters, digits")
    given, texts = dict(options), dict[str, str]()
    for name in ("jobs", "inputs"):
        if path := given.pop(name, None):
            texts[name] = _text(name, Path(str(path)))
    base = FleetBag(BagPlace("", (), (), "", False, True), robot or "", model=model or "",
                    options={key: value for key, value in given.items() if value is not None},
                    texts=texts)  # fmt: skip
    if model:
        models.digest_of(model)
    is_table = where.lower().endswith(".csv")
    if is_table:
        rows = _table(where, base, split, complete)
    else:
        rows = (replace(base, place=place) for place in find_bags(where, split, complete))
    found: list[FleetBag] = []
    for row in rows:
        bag = _of_robot(row)
        place = bag.place
        try:
            if place.problem is None:
                if not bag.model:
                    column = "--model, or a column 'model' of the table"
                    raise DatasetError(f"no model for {place.address}", column)
                bag = replace(bag, model_digest=models.digest_of(bag.model))
            found.append(bag)
        except RobotEnergyError as error:
            if not is_table:
                raise
            found.append(replace(bag, place=replace(place, problem=error)))
    if not found and not complete:
        raise no_bag(where)
    return found


def _of_robot(bag: FleetBag) -> FleetBag:
    """The bag with the name of its robot, which is that of a folder of the dataset."""
    robot = bag.robot or _robot_of(bag.place.address, bag.place.is_folder)
    if len(quote(robot, safe=" ")) <= MAX_NAME:
        return replace(bag, robot=robot)
    long = DatasetError(
        f"the name of the robot, {shown(robot, MAX_SHOWN)}, is too long", "a short one"
    )
    problem = bag.place.problem or long
    return replace(bag, robot=robot[:SHORT], place=replace(bag.place, problem=problem))


def _robot_of(address: str, is_folder: bool) -> str:
    """Name of the folder in which a recording lies, whether the bag is all of it or one file."""
    folder = PurePosixPath(address.rstrip("/")).parent
    is_part = not is_folder and is_of_folder(address)
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
    """The rows of a CSV table; paths of bags start at its folder, others may.

    A row that cannot be used is a bag with its problem.
    """
    try:
        text = read_whole(where).decode("utf-8-sig")
    except ValueError as error:
        raise DatasetError(f"{where} cannot be read ({error})", "a CSV table in UTF-8") from error
    rows = csv.DictReader(io.StringIO(text, newline=""), restkey="", restval="")
    try:
        names = rows.fieldnames or []
    except csv.Error as error:
        raise DatasetError(f"{where} cannot be read ({error})", "a CSV table") from error
    unknown = [name for name in names if name not in COLUMNS]
    if unknown or "bag" not in names:
        found = f"has the column '{shown(unknown[0])}'" if unknown else "has no column 'bag'"
        raise DatasetError(f"{where} {found}", f"columns of {', '.join(COLUMNS)}; bag is needed")
    while True:
        first = rows.line_num + 1
        row: dict[str, str] = {}
        try:
            row = next(rows)
            yield from _row(where, first, row, base, split, complete)
        except StopIteration:
            return
        except Exception as error:  # a row ends no fleet
            if isinstance(error, csv.Error):
                error = DatasetError(
                    f"line {first} of {where} cannot be read ({error})", "a row of a CSV table"
                )
            address = row.get("bag") or f"{where}, line {first}"
            robot = row.get("robot") or base.robot
            yield replace(base, place=unusable(address, error), robot=robot, named=(address,))


def _row(
    where: str, line: int, row: dict[str, str], base: FleetBag, split: bool, complete: bool
) -> Iterator[FleetBag]:
    folder = Path(where).parent
    if row.get("") or not row["bag"]:
        raise DatasetError(
            f"line {line} of {where} has {'too many cells' if row.get('') else 'no bag'}",
            "one cell for each column",
        )
    texts, options = dict(base.texts), dict(base.options)
    if row.get("jobs"):
        texts["jobs"] = _text("jobs", Path(_near(folder, row["jobs"])))
    if row.get("effort"):
        options["effort"] = row["effort"]
    path = row["bag"]  # starts at the folder of the table
    if "://" in where and "://" not in path and not path.startswith("/"):
        path = f"{where.rpartition('/')[0]}/{path}"
    elif "://" not in path:
        path = str(folder / os.path.expanduser(path))
    address = named_on(*file_system(path))
    own = replace(
        base,
        robot=row.get("robot") or base.robot,
        programme=row.get("programme") or "",
        shift=row.get("shift") or "",
        model=_near(folder, row.get("model") or base.model),
        options=options,
        texts=texts,
        named=(address, row["bag"]),
    )
    places = list(find_bags(path, split, complete))
    if not places and not complete:
        places = [unusable(address, no_bag(address))]
    for place in places:
        yield replace(own, place=place)


def _near(folder: Path, name: str) -> str:
    """A path that starts at the folder of the table, if it is there; else as it stands."""
    path = folder / name
    return str(path) if name and "://" not in name and os.path.exists(path) else name
