"""Whose the project is: the one place of its address, and of the header of its source files.

`python .ci/ownership.py` names the files that say something else; with `--fix` it mends them. They
are the `package.xml` and `setup.py` of each package, and every source file of the packages that are
released for ROS alone. Before a first release, fill in the four values below and run it with
`--fix`.
"""

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from textwrap import wrap

NAME = "Robot energy maintainers"
EMAIL = "maintainers@robot-energy.invalid"
URL = "https://robot-energy.invalid"
YEAR = 2026

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("src", "ros2_energy_monitor", "ros2_energy_msgs")
WITH_HEADERS = ("ros2_energy_monitor", "ros2_energy_msgs")  # the library has its LICENSE alone
COMMENTS = {".py": "# ", ".c": "// ", ".h": "// "}
WIDTH = 100
# The notice of the appendix of LICENSE. `ament_copyright` knows no SPDX line, but any line breaks.
NOTICE = (
    'Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file '
    "except in compliance with the License. You may obtain a copy of the License at "
    "http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in "
    'writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT '
    "WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the "
    "specific language governing permissions and limitations under the License."
)
# Comment at the beginning of a file that begins with a copyright.
OLD = re.compile(r"\A(?:#|//) Copyright .*\n(?:(?:#|//).*\n)*\n*")
SHEBANG = re.compile(r"\A(?:#!.*\n)?")


def header(suffix: str) -> str:
    """Return the header of a source file.

    Args:
        suffix: Of its name, such as ``.py``.
    """
    lines = [f"Copyright {YEAR} {NAME}", *wrap(NOTICE, WIDTH - len(COMMENTS[suffix]))]
    return "".join(f"{COMMENTS[suffix]}{line}\n" for line in lines)


def with_header(text: str, suffix: str) -> str:
    """Return the text of a source file with its header, in place of another one."""
    shebang = SHEBANG.match(text)[0]
    rest = OLD.sub("", text.removeprefix(shebang).lstrip("\n"))
    return f"{shebang}{header(suffix)}\n{rest}" if rest else text


def with_owner(text: str, name: str) -> str:
    """Return the text of a package.xml or setup.py with the address of the owner."""
    if name == "setup.py":
        text = re.sub(r'^    (?:maintainer(?:_email)?|url)=".*",\n', "", text, flags=re.MULTILINE)
        lines = f'    maintainer="{NAME}",\n    maintainer_email="{EMAIL}",\n    url="{URL}",\n'
        return text.replace("    zip_safe=False,\n", f"    zip_safe=False,\n{lines}")
    text = re.sub(r"^  <(?:maintainer|url) .*\n", "", text, flags=re.MULTILINE)
    places = (("website", URL), ("repository", URL), ("bugtracker", f"{URL}/issues"))
    urls = "".join(f'  <url type="{kind}">{place}</url>\n' for kind, place in places)
    text = re.sub(r"(?m)^(  <license>.*\n)", rf"\1{urls}", text)
    maintainer = f'  <maintainer email="{EMAIL}">{NAME}</maintainer>\n'
    return re.sub(r"(?m)^  <license>", f"{maintainer}  <license>", text)


def wanted() -> Iterator[tuple[Path, str, str]]:
    """Yield every file that names the owner, what it says, and what it must say."""
    for folder in (ROOT / name for name in PACKAGES):
        for path in (folder / "package.xml", folder / "setup.py"):
            if path.is_file():
                text = path.read_text(encoding="utf-8")
                yield path, text, with_owner(text, path.name)
        if folder.name not in WITH_HEADERS:
            continue
        for path in sorted(folder.rglob("*")):
            inside = path.relative_to(folder).parts
            # Those that `ament_copyright` leaves out, and what a build made.
            left_out = inside == ("setup.py",) or inside[0] == "build"
            left_out = left_out or any(part[0] in "._" for part in inside[:-1])
            if path.suffix in COMMENTS and not left_out:
                text = path.read_text(encoding="utf-8")
                yield path, text, with_header(text, path.suffix)


def main(arguments: list[str]) -> int:
    """Name or mend the files that differ; return the exit code: 1 if some do."""
    found = [(path, new) for path, text, new in wanted() if text != new]
    for path, new in found:
        print(path.relative_to(ROOT))
        if "--fix" in arguments:
            path.write_text(new, encoding="utf-8")
    return 1 if found and "--fix" not in arguments else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
