# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Shared memory that a killed process has left half made.

Fast DDS, the middleware of Jazzy, makes one file per port in ``/dev/shm`` and then marks it as
ready in its first word. A process killed between the two leaves a port that is never ready, and
every process on the machine that opens it waits inside the creation of its node, without end and
without a word. Making a port takes a fraction of a millisecond; one that is not ready after two
seconds has no maker any more.
"""

from __future__ import annotations

import os
import re
import stat
import time
from collections.abc import Iterator
from pathlib import Path

FOLDER = Path("/dev/shm")
PORT = re.compile(r"fastrtps_port\d+")
READY = 2  # first word of a port that is in use; 0 and 1 before
ORPHANED = 2.0  # s
LOOK_AGAIN = 0.05  # s


def clear_ports(folder: Path = FOLDER, orphaned: float = ORPHANED) -> list[str]:
    """Return a sentence for each port left half made, removed so that nodes can start again.

    Removing takes the name away only; a process that has the file open keeps it.

    Args:
        orphaned: Age from which a port that is not ready has no maker any more. [s]
    """
    since: dict[Path, float] = {}
    while half_made := list(_half_made(folder)):
        now = time.monotonic()
        since = {path: since.get(path, now) for path in half_made}
        if now - max(since.values()) >= orphaned:  # one that others make at this moment is not old
            return [_remove(path) for path in half_made]
        time.sleep(LOOK_AGAIN)
    return []


def _half_made(folder: Path) -> Iterator[Path]:
    try:
        paths = [path for path in folder.iterdir() if PORT.fullmatch(path.name)]
    except OSError:
        return
    for path in sorted(paths):
        try:
            number = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError:  # gone, of another user, or a link
            continue
        try:
            if not stat.S_ISREG(os.fstat(number).st_mode):
                continue  # no port: a pipe or a folder that has the name of one
            word = os.read(number, 4)
        except OSError:
            continue
        finally:
            os.close(number)
        if int.from_bytes(word, "little") != READY:
            yield path


def _remove(path: Path) -> str:
    what = f"{path}, shared memory of the middleware that a killed process left incomplete"
    try:
        os.unlink(path)
    except FileNotFoundError:
        return f"{what}, is gone"
    except OSError as error:
        return (
            f"{what}, blocks every node that starts and cannot be removed ({error.strerror}); "
            f"remove it: sudo rm {path}"
        )
    return f"{what}, was removed: no node could start while it was there"
