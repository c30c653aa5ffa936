"""Write the hash of every pinned distribution into the requirements files.

Change a version in `.ci/requirements*.txt`, then run `python .ci/lock.py` in the environment of the
set-up, which has `uv`. The hashes are those that the package index states for the files that fit:
wheels for Python 3.11 and 3.12 on Linux (x86_64, aarch64), or the source where there is none.
"""

import re
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Any

CI = Path(__file__).resolve().parent
PYTHONS = ("cp311", "cp312")
STABLE = re.compile(r"cp3([2-9]|10|11|12)$")  # wheels of the stable ABI fit later Pythons
MACHINES = ("x86_64", "aarch64")
HASH = re.compile(r"\s*\\\n\s*--hash=\S+")


def main() -> int:
    """Rewrite the files and return the exit code: 1 if a distribution has no file that fits."""
    paths = sorted(CI.glob("requirements*.txt"))
    texts = {path: HASH.sub("", path.read_text(encoding="utf-8")) for path in paths}
    found = [p for text in texts.values() for p in locked(text)]  # one file may differ from another
    hashes = {(p["name"], p["version"]): fitting(p) for p in found}
    lacking = [f"{name} {version}" for (name, version), found in hashes.items() if not found]
    for path, text in texts.items():
        lines = [with_hashes(line, hashes) for line in text.splitlines()]
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    for what in lacking:
        print(f"{what} has no file for Python 3.11 or 3.12 on Linux")
    return 1 if lacking else 0


def locked(requirements: str) -> list[dict[str, Any]]:
    """Return what the package index knows of each pinned distribution."""
    with tempfile.TemporaryDirectory() as folder:
        pins, lock = Path(folder, "pins.in"), Path(folder, "pylock.toml")
        pins.write_text(requirements, encoding="utf-8")
        options = ["--no-deps", "--universal", "--python-version=3.11", "--format=pylock.toml"]
        command = ["uv", "pip", "compile", "--quiet", *options, f"--output-file={lock}", pins]
        subprocess.run(command, check=True)
        return tomllib.loads(lock.read_text(encoding="utf-8"))["packages"]


def fitting(package: dict[str, Any]) -> list[str]:
    """Return the hashes of the wheels that fit, or of the source if none does."""
    wheels = [wheel for wheel in package.get("wheels", []) if fits(wheel["url"])]
    source = [package["sdist"]] if "sdist" in package else []
    return sorted(entry["hashes"]["sha256"] for entry in wheels or source)


def fits(url: str) -> bool:
    """Return whether a wheel serves a supported Python on a supported machine."""
    python, abi, platform = url.removesuffix(".whl").split("-")[-3:]
    pythons = python.split(".")
    if abi not in ("none", "abi3", *PYTHONS):
        return False
    if not any(word in ("py3", *PYTHONS) or STABLE.match(word) for word in pythons):
        return False
    return platform == "any" or (
        "linux" in platform and platform.endswith(MACHINES) and "musllinux" not in platform
    )


def with_hashes(line: str, hashes: dict[tuple[str, str], list[str]]) -> str:
    """Return one line of a requirements file with its hashes behind it."""
    pin = re.match(r"([A-Za-z0-9._-]+)==([^\s;]+)", line)
    if pin is None:
        return line
    name = re.sub(r"[-_.]+", "-", pin[1]).lower()
    return " \\\n    ".join([line, *(f"--hash=sha256:{found}" for found in hashes[name, pin[2]])])


if __name__ == "__main__":
    sys.exit(main())
