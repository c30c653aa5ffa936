"""Every check of the project, in order, ending in one line with the number of tests.

Runs inside the environment of `.venv/env.sh`. All stages run, whatever fails; the exit code
is 1 if any did. `check.py --lint` stops after format, lint and types. On two or more processors
the stages run in lanes at the same time. Lanes that compute take the next stage of a common list,
the longest first, so that all end at about the same time; a lane of its own has the tests of the
nodes, which mostly wait. The first lane writes to the terminal; the output of the others follows
when it has ended.

Compiled modules are kept: tests start Python many times, and compiling takes longer than the rest
of such a start.

The unit tests of the packages that run online measure the coverage of these packages by lines;
below MIN_COVERAGE they fail. Measuring doubles the time of a test on Python 3.11, so there, and
for the other packages, only `check.py --coverage` (`make coverage`) measures; it runs no other
stage.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import ExitStack, suppress
from itertools import chain
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import IO

ROOT = Path(__file__).resolve().parent.parent
BUILD = ROOT / "build"
SOURCES = ["src", "test", "ros2_energy_monitor", ".ci"]
# A stage that takes longer than this hangs; on a busy machine one took half an hour. [s]
STAGE_LIMIT = 7200.0
# The coverage of the packages that run online may not fall below this. [%]
MIN_COVERAGE = 94.0
COVERAGE = BUILD / "test" / "coverage.json"
RUNNING: list[subprocess.Popen[bytes]] = []
STOPPED = threading.Event()

LINT = {
    "format": [["ruff", "format", "--check", "--output-format=concise", *SOURCES]],
    "lint": [["ruff", "check", "--output-format=concise", *SOURCES]],
    "types": [
        ["pyright", "-p", "src/pyproject.toml"],
        ["pyright", "-p", "ros2_energy_monitor/pyrightconfig.json"],
    ],
}
# Folders of test/unit with the tests of the packages that run online, and the folders of these. As
# folders: of a package in a package coverage imports the outer one, then forgets all it imported,
# and the C part of PyYAML does not stand that.
ONLINE = [
    *("accounting", "cdr", "certainty", "inputs", "messages", "physics", "pipeline"),
    *("store", "timeline"),
]
MEASURED = [
    *("accounting", "bag/cdr", "certainty", "inputs", "messages", "physics", "pipeline", "store"),
    "timeline",
]
LIBRARY = [path.parent.name for path in sorted(ROOT.glob("src/robot_energy*/__init__.py"))]
MEASURE = ["--cov-report=", f"--cov-report=json:{COVERAGE}"]
# Python 3.12 counts lines by sys.monitoring, which costs little.
CHEAP = sys.version_info >= (3, 12)


def folders(*names: str) -> list[str]:
    """Return the folders of test/unit with these names."""
    return [f"test/unit/{name}" for name in names]


APART = {
    "studies": folders("papers", "fleet", "optimization", "report"),
    "identification": folders("identify"),
    "scenarios": ["test/scenario", "test/browser", "test/golden", "test/packaging"],
}
TESTS = {
    "tests": [
        *("-c", "test/pytest.ini", "test"),
        *(f"--ignore={folder}" for folder in (*folders(*ONLINE), *chain(*APART.values()))),
    ],
    **{name: ["-c", "test/pytest.ini", *paths] for name, paths in APART.items()},
    "online tests": [
        *("-c", "test/pytest.ini", *folders(*ONLINE)),
        *((*(f"--cov=src/robot_energy/{name}" for name in MEASURED), *MEASURE) if CHEAP else ()),
    ],
    "node tests": ["-c", "ros2_energy_monitor/setup.cfg", "ros2_energy_monitor/test"],
}
# In the order in which lanes take them: the longest first, by processor time (decision 0190). A
# stage that takes as long as a quarter of all must not begin last.
ORDER = ["tests", "types", "studies", "identification", "scenarios", "online tests"]
# They mostly wait, so a lane of theirs takes little from the others.
WAITING = ["node tests"]
# More lanes than this would not end earlier.
MAX_LANES = 4
WHOLE = {
    "coverage": ["-c", "test/pytest.ini", "test", *(f"--cov={name}" for name in LIBRARY), *MEASURE]
}


class Checks:
    """Stages by name, and what became of those that have run.

    Args:
        stages: Names of stages, in the order of the summary.
    """

    def __init__(self, stages: Iterable[str]) -> None:
        self.names = list(stages)
        self.words: dict[str, str] = {}
        self.counts: dict[str, Counter[str]] = {}

    def run(self, stages: "SimpleQueue[str]", output: IO[str] | None = None) -> None:
        """Run stages until the queue is empty.

        Args:
            stages: Names of those that nobody has begun.
            output: Where their output goes; None for the terminal.
        """
        with suppress(Empty):
            while True:
                self.run_one(stages.get_nowait(), output)

    def run_one(self, name: str, output: IO[str] | None = None) -> None:
        """Run one stage; note what became of it."""
        if name in LINT:
            code = any([run(name, command, output) for command in LINT[name]])
        else:
            tests = TESTS | WHOLE
            domain = domain_id(list(tests).index(name))
            code, self.counts[name] = run_pytest(name, tests[name], domain, output)
        self.words[name] = f"{name} {'FAILED' if code else 'ok'}"


def main(arguments: list[str]) -> int:
    """Run the stages, print the summary, return the exit code."""
    started = time.monotonic()
    STOPPED.clear()
    lint_only = "--lint" in arguments
    if not lint_only:
        COVERAGE.unlink(missing_ok=True)
    processors = 1
    if lint_only:
        checks = Checks(LINT)
    elif "--coverage" in arguments:
        checks = Checks(WHOLE)
    else:
        checks = Checks([*LINT, *TESTS])
        processors = min(os.cpu_count() or 1, MAX_LANES)
    run_lanes(checks, processors)
    words = [checks.words.get(name, f"{name} FAILED") for name in checks.names]
    if "--coverage" in arguments or (CHEAP and not lint_only):
        words.append(coverage(COVERAGE))
    print(f"\n{', '.join(words)} in {time.monotonic() - started:.0f} s")
    counts = sum(checks.counts.values(), Counter[str]())
    if not lint_only:
        skipped = f", {counts['skipped']} skipped" if counts["skipped"] else ""
        print(f"{counts['passed']} passed, {counts['failed']} failed{skipped}")
    return 1 if any(word.endswith("FAILED") for word in words) else 0


def run_lanes(checks: Checks, processors: int) -> None:
    """Run all stages, on several processors at the same time."""
    computing, waiting = queue_of(checks.names), None
    if processors > 1:
        waiting = queue_of(name for name in checks.names if name in WAITING)
        names = [name for name in checks.names if name not in WAITING]
        computing = queue_of(sorted(names, key=[*ORDER, *names].index))
    with ExitStack() as stack:
        others = [computing] * (processors - 1) + ([waiting] if waiting else [])
        outputs = [
            stack.enter_context(tempfile.TemporaryFile("a+", errors="replace")) for _ in others
        ]
        pool = stack.enter_context(ThreadPoolExecutor(max(len(others), 1)))
        parallel = [pool.submit(checks.run, *lane) for lane in zip(others, outputs, strict=True)]
        try:
            checks.run(computing)
            for each in parallel:
                each.result()
        finally:
            STOPPED.set()
            for process in list(RUNNING):
                stop(process)
            wait(parallel)
            for output in outputs:
                output.seek(0)
                print(output.read(), flush=True)


def queue_of(names: Iterable[str]) -> "SimpleQueue[str]":
    """Return a queue of these."""
    queue: SimpleQueue[str] = SimpleQueue()
    for name in names:
        queue.put(name)
    return queue


def coverage(report: Path) -> str:
    """Return the share of lines that the tests run, with FAILED if it is below the floor.

    Args:
        report: What pytest-cov wrote as JSON.
    """
    try:
        percent = float(json.loads(report.read_text())["totals"]["percent_covered"])
    except (OSError, ValueError, KeyError):
        return "coverage not measured: FAILED"
    if percent >= MIN_COVERAGE:
        return f"coverage {percent:.1f} %"
    return f"coverage {percent:.1f} %, below {MIN_COVERAGE:g} %: FAILED"


def domain_id(position: int) -> int:
    """Return a ROS domain of its own, 1 to 100, for each test process of each run."""
    return (7 * os.getpid() + position) % 100 + 1


def run_pytest(
    name: str, paths: list[str], domain: int, output: IO[str] | None = None
) -> tuple[int, Counter[str]]:
    """Run one pytest process; return its exit code and the counts of its report."""
    report = BUILD / "test" / f"{name.replace(' ', '_')}.xml"
    report.unlink(missing_ok=True)
    code = run(
        name,
        [sys.executable, "-m", "pytest", *paths, f"--junitxml={report}"],
        output,
        COVERAGE_FILE=str(BUILD / "test" / "coverage"),
        **({"COVERAGE_CORE": "sysmon"} if CHEAP else {}),
        OPENBLAS_NUM_THREADS="1",  # the lanes share the processors
        HYPOTHESIS_NO_PLUGINS="1",  # that of trio imports it, and no test needs it
        ROS_DOMAIN_ID=str(domain),
        ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST",
    )
    try:
        suites = list(ET.parse(report).getroot().iter("testsuite"))
    except (OSError, ET.ParseError):
        print(f"check: pytest of the {name} wrote no report; counted as one failure", file=output)
        return code or 1, Counter(failed=1)
    total, failed, skipped = (
        sum(int(suite.get(key, 0)) for suite in suites for key in keys)
        for keys in (("tests",), ("failures", "errors"), ("skipped",))
    )
    passed = max(total - failed - skipped, 0)
    # A run that fails without a failed test (none found, crashed) is one failure too.
    return code, Counter(passed=passed, failed=failed or int(code != 0), skipped=skipped)


def run(name: str, command: list[str], output: IO[str] | None = None, **settings: str) -> int:
    """Run one command; return its exit code.

    Args:
        name: Of the stage.
        command: With its arguments.
        output: Where its output goes; None for the terminal.
        settings: Environment variables that it has besides those of this process.
    """
    if STOPPED.is_set():
        return 1
    print(f"\n=== {name}: {' '.join(command).replace(f'{ROOT}/', '')}", file=output, flush=True)
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    # A session of its own, so that a hanging stage ends with all its children.
    process = subprocess.Popen(
        command,
        cwd=ROOT,
        env=environment | settings,
        stdout=output,
        stderr=output and subprocess.STDOUT,
        start_new_session=True,
    )
    RUNNING.append(process)
    try:
        return process.wait(timeout=STAGE_LIMIT)
    except subprocess.TimeoutExpired:
        print(f"check: {name} took longer than {STAGE_LIMIT:.0f} s", file=output, flush=True)
        return 1
    finally:
        if process.poll() is None:
            stop(process)
        RUNNING.remove(process)


def stop(process: subprocess.Popen[bytes]) -> None:
    """Interrupt a stage and its children, and kill what is left after a while."""
    try:
        os.killpg(process.pid, signal.SIGINT)
        process.wait(timeout=10.0)
    except ProcessLookupError:
        process.wait()
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


if __name__ == "__main__":
    # Being terminated ends the stages as Ctrl-C does.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        sys.exit(main(sys.argv[1:]))
    except KeyboardInterrupt:
        sys.exit(130)
