"""Tries one target, guided by coverage: ``python test/fuzz/harness.py TARGET FOLDER SECONDS``.

Leaves the input of a failure in FOLDER/crash-* (or timeout-*, oom-*) and ends with an exit
code other than 0. The samples it begins with are made here.
"""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import atheris

LIBRARY = Path(__file__).resolve().parents[2] / "src"
PACKAGES = sorted(path.parent.name for path in LIBRARY.glob("robot_energy*/__init__.py"))

with atheris.instrument_imports(include=PACKAGES):
    import targets

# Against hangs only; bounds.py measures the plain code. Instrumented code is slower, and
# atheris itself keeps some 0.8 MB for every input of the slow targets.
SECONDS_EACH = 30
MEBIBYTES = 4096


def main() -> None:
    """Run until the time is over or something fails."""
    name, folder, seconds = sys.argv[1], Path(sys.argv[2]), int(sys.argv[3])
    corpus = folder / "corpus"
    corpus.mkdir(parents=True, exist_ok=True)
    target = targets.TARGETS[name]
    for index, seed in enumerate(target.seeds()):
        (corpus / f"seed_{index}").write_bytes(seed)
    warnings.simplefilter("error")

    def once(data: bytes) -> None:
        target.run(data)

    options = [
        f"-max_total_time={seconds}",
        f"-timeout={SECONDS_EACH}",
        f"-rss_limit_mb={MEBIBYTES}",
        "-max_len=20000",
        "-len_control=0",
        f"-artifact_prefix={folder}/",
        "-print_final_stats=1",
    ]
    atheris.Setup([sys.argv[0], *options, str(corpus)], once)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
