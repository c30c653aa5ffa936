# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Arguments of the launch files of this package: names that are known, and their choices."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from pathlib import Path

BOOLEANS = ["true", "false", "True", "False", "1", "0"]
LEVELS = ["debug", "info", "warn", "error", "fatal"]


def is_true(value: str) -> bool:
    """Return whether an argument says true."""
    return value.lower() in ("true", "1")


def parameter_files(given: str) -> list[str]:
    """Return the parameter files that an argument names: one, or none.

    ROS would start the nodes without a file that is not there.

    Args:
        given: Path of a file; ``~`` stands for the home folder, which a shell does not put in
            after ``:=``. Empty for none.
    """
    if not given:
        return []
    path = Path(given).expanduser()
    if not path.is_file():
        raise RuntimeError(
            f"params_file is '{given}', and {path.absolute()} is not a file; "
            "expected the path of a parameter file"
        )
    return [str(path)]


def check_arguments(command_line: Sequence[str], file: str, known: Iterable[str]) -> None:
    """Refuse arguments of the command line that a launch file does not have.

    Only where the file itself was launched: one that includes it has arguments of its own.
    """
    if not any(Path(word).name == Path(file).name for word in command_line):
        return
    known = tuple(known)
    for name in (word.partition(":=")[0] for word in command_line if ":=" in word):
        if name not in known:
            near = get_close_matches(name, known, n=1)
            meant = f"did you mean '{near[0]}'? " if near else ""
            raise RuntimeError(
                f"unknown launch argument '{name}'; {meant}expected one of {', '.join(known)}"
            )
