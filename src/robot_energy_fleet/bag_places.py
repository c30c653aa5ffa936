"""Where the bags of a fleet are: found in a folder, by a pattern, or by an address.

Addresses are local paths, or URLs of the protocols of fsspec that are named here.
"""

from __future__ import annotations

import glob
import hashlib
import json
import os
import stat
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, cast

from fsspec.core import url_to_fs  # type: ignore[import-untyped]
from fsspec.implementations.local import LocalFileSystem  # type: ignore[import-untyped]

from robot_energy.bag.mcap_records import MAGIC
from robot_energy.bag.metadata import FILE_NAME
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import DatasetError
from robot_energy.foundation.shown_text import shown

MESSAGES = (".mcap", ".db3", ".zstd")  # endings of files with messages
CHANGED = ("ETag", "mtime", "LastModified", "last_modified", "updated", "created")
DIGITS = 16  # of a hash in a name
UNREAD = "unread"  # instead of the state of a bag that is to be tried again
PROTOCOLS = (
    "file", "s3", "gs", "az", "abfs", "http", "https", "ftp", "sftp", "smb", "hdfs", "webhdfs",
    "memory",
)  # fmt: skip
CHAIN = "::"  # between the file systems of an address that goes through several

Infos = dict[str, dict[str, Any]]


def digest(*parts: object) -> str:
    """Return a short hash of plain values."""
    text = json.dumps(parts, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:DIGITS]


class BagPlace(Described):
    """Where a bag is."""

    address: str
    files: Annotated[tuple[str, ...], "Of messages and metadata; none: it is not there."]
    sizes: Annotated[tuple[int, ...], "Of these files. [bytes]"]
    state: str
    is_folder: Annotated[bool, "Whether it is a folder of rosbag2."]
    is_local: Annotated[bool, "Whether it can be read where it is."]
    problem: Annotated[Exception | None, "Why it cannot be used; None: it can."] = None

    @property
    def size(self) -> int:
        """Of all files. [bytes]"""
        return sum(self.sizes)


def unusable(address: str, problem: Exception) -> BagPlace:
    """Return the place of a bag that cannot be used."""
    return BagPlace(shown(address), (), (), UNREAD, False, True, problem)


def no_bag(where: str) -> DatasetError:
    """Return the error of a place without bags."""
    gone = "://" not in where and not glob.has_magic(where) and not Path(where).exists()
    return DatasetError(
        f"{shown(where)} {'does not exist' if gone else 'holds no bag'}",
        "MCAP files or folders of rosbag2",
        "check the path",
    )


def file_system(address: str) -> tuple[Any, str]:
    """Return the file system of an address, and the path there."""
    protocol, mark, _ = address.partition("://")
    if not mark or protocol == "file":
        local = cast("Any", LocalFileSystem())
        return local, str(local._strip_protocol(address))
    if protocol not in PROTOCOLS or CHAIN in address:
        wrong = protocol if protocol not in PROTOCOLS else CHAIN
        raise DatasetError(
            f"the address {shown(address)} has '{shown(wrong)}'",
            f"a local path, or one of the protocols {', '.join(PROTOCOLS)}",
            "copy the bags to a folder and name that",
        )
    try:
        return cast("tuple[Any, str]", url_to_fs(address))
    except Exception as error:  # each client has errors of its own
        raise _unreadable(address, error) from error


def _unreadable(address: str, error: Exception) -> DatasetError:
    reason = " ".join(str(error).split()) or type(error).__name__
    return DatasetError(f"{shown(address)} cannot be read ({reason})", "a folder, pattern or bag")


def read_whole(address: str) -> bytes:
    """Return the content of a small file."""
    system, path = file_system(address)
    try:
        if is_local(system) and os.path.exists(path) and not os.path.isfile(path):
            raise OSError("it is not a file")  # a pipe would be waited for
        return cast("bytes", system.cat_file(path))
    except Exception as error:
        raise _unreadable(address, error) from error


class Folders:
    """The files below local folders, each counted once.

    Links to folders are followed where they lead to files that are not below the folders anyway.
    """

    def __init__(self, system: Any) -> None:
        self.infos: Infos = {}
        self.problems: dict[str, Exception] = {}
        self._system = system
        self._known: set[tuple[int, int]] = set()  # folders and links
        self._links: list[str] = []  # to files

    def add(self, roots: list[str]) -> None:
        """Add the files at and below places."""
        waiting = sorted(roots, key=os.path.islink)
        while waiting:
            root = waiting.pop(0)
            if not os.path.isdir(root):
                self._file(root)
                continue
            for folder, names, files in os.walk(root, onerror=self._failed):
                names.sort()
                if not self._is_new(os.stat(folder)):
                    names.clear()
                    continue
                paths = [os.path.join(folder, name) for name in names]
                waiting += sorted(path for path in paths if os.path.islink(path))
                for name in files:
                    self._file(os.path.join(folder, name))
        self._follow_files()

    def _is_new(self, status: os.stat_result) -> bool:
        own = status.st_dev, status.st_ino
        new = own not in self._known
        self._known.add(own)
        return new

    def _failed(self, error: OSError) -> None:
        found = f"{error.filename} cannot be read ({error.strerror})"
        self.problems[str(error.filename)] = DatasetError(
            found, "a folder or bag that can be read", "check its permissions"
        )

    def _file(self, path: str) -> None:
        name, is_link = PurePosixPath(path).name, os.path.islink(path)
        is_bag = name.endswith(MESSAGES) or name == FILE_NAME
        if not is_bag and not (is_link and "." not in name):  # else a folder may have been meant
            return
        if is_link and not self._is_new(os.lstat(path)):
            return
        try:
            info = cast("dict[str, Any]", self._system.info(path))
            path.encode()
        except FileNotFoundError as error:
            if is_link:
                found = f"the link {path} leads to {os.readlink(path)}, which is not there"
                self.problems[path] = DatasetError(found, "a bag, or a folder of bags")
            elif os.path.lexists(path):
                self._failed(error)
        except UnicodeEncodeError:
            found = f"the name {shown(path)} is not UTF-8"
            self.problems[path] = DatasetError(found, "a name in UTF-8", "rename it")
        except OSError as error:
            self._failed(error)
        else:
            if is_bag and not stat.S_ISREG(info["mode"]):
                found = f"{path} is not a file"
                self.problems[path] = DatasetError(found, "a bag in a file or folder")
            elif is_bag and is_link:
                self._links.append(path)
            elif is_bag:
                self.infos[path] = info

    def _follow_files(self) -> None:
        """Add files to which only links lead, each by its first link."""
        known = {os.path.realpath(path) for path in self.infos} if self._links else set[str]()
        for path in sorted(self._links):
            if (target := os.path.realpath(path)) not in known:
                known.add(target)
                self.infos[path] = cast("dict[str, Any]", self._system.info(path))


def find_bags(where: str, split: bool = False, complete: bool = False) -> Iterator[BagPlace]:
    """Return bags in order of their addresses; first what cannot be read, with its problem.

    A folder with a metadata.yaml is a bag, and so is one whose MCAP files have its name and a
    number, as rosbag2 names them: a recording that is not closed yet, or never was. Elsewhere, and
    where files are named themselves, each MCAP file is.

    Args:
        split: Whether each MCAP file is a bag of its own in folders of rosbag2 too.
        complete: Whether to leave out what is still being written: folders without metadata,
            MCAP files without their end.
    """
    system, root = file_system(where)
    infos: Infos = {}
    problems: dict[str, Exception] = {}
    try:
        if is_local(system):
            roots = [root]
            if "*" in root:
                roots = glob.glob(root, recursive=True, include_hidden=True)
            found = Folders(system)
            found.add(roots)
            infos, problems = found.infos, found.problems
        else:
            roots = cast("list[str]", system.glob(root) if "*" in root else [root])
            for one in roots:
                infos |= cast("Infos", system.find(one, detail=True))
    except Exception as error:  # each client has errors of its own
        raise _unreadable(where, error) from error
    for address, problem in sorted(problems.items()):
        yield unusable(address, problem)
    named = set(roots)
    folders: dict[str, list[str]] = {}
    for path in sorted(infos):
        folders.setdefault(str(PurePosixPath(path).parent), []).append(path)
    for folder, paths in sorted(folders.items()):
        messages = [path for path in paths if path.endswith(MESSAGES)]
        metadata = f"{folder}/{FILE_NAME}"
        mcap = [path for path in messages if path.endswith(".mcap")]
        unclosed = all(is_of_folder(path) and path not in named for path in mcap)
        if messages and (metadata in paths or unclosed) and not (split and mcap):
            if not complete or (metadata in paths and infos[metadata].get("size")):
                yield _place(system, folder, infos, [*messages, metadata])
            continue
        for path in mcap:
            if not complete or _has_end(system, path, infos[path]):
                yield _place(system, path, infos, [path])


def is_of_folder(path: str) -> bool:
    """Return whether an MCAP file has the name of its folder and a number."""
    *_, folder, file = ("", "", *filter(None, path.split("/")))
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
    sizes = tuple(int(info.get("size") or 0) for _, info in own)
    places = tuple(named_on(system, path) for path, _ in own)
    named = named_on(system, address)
    return BagPlace(named, places, sizes, state, address not in infos, is_local(system))


def named_on(system: Any, path: str) -> str:
    """Return the address of a path."""
    return path if is_local(system) else str(system.unstrip_protocol(path))


def is_local(system: Any) -> bool:
    """Return whether a file system is that of this host."""
    names = system.protocol
    return "file" in ((names,) if isinstance(names, str) else tuple(names))


def _has_end(system: Any, path: str, info: Mapping[str, Any]) -> bool:
    """Whether an MCAP file was closed by its writer."""
    size = int(info.get("size") or 0)
    if size <= 2 * len(MAGIC):
        return False
    try:
        return cast("bytes", system.cat_file(path, start=size - len(MAGIC))) == MAGIC
    except OSError:
        return True  # its replay says why it cannot be read
