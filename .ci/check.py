"""Every check of the project, in order, ending in one line with the number of tests.

Runs inside the environment of `.venv/env.sh`. All stages run, whatever fails; the exit code
is 1 if any did. `check.py --lint` stops after format, lint and types. On two or more processors
the stages run in three lanes at the same time: the first writes to the terminal, the output of the
others follows when the first has ended. Two lanes compute; that of the nodes mostly waits.

The unit tests of the packages that run online measure the coverage of these packages by lines;
below MIN_COVERAGE they fail. Measuring doubles the time of a test on Python 3.11, so the
others are measured only by `check.py --coverage` (`make coverage`), which runs no other stage.
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
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

ROOT = Path(__file__).resolve().parent.parent
BUILD = ROOT / "build"
SOURCES = ["src", "test", "ros2_energy_monitor", ".ci"]
# A stage that takes longer than this hangs. [s]
STAGE_LIMIT = 2400.0
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
# The packages that run online; each has a folder of the same name in test/unit.
ONLINE = ["accounting", "cdr", "inputs", "messages", "physics", "pipeline", "store", "timeline"]
FOLDERS = [f"test/unit/{name}" for name in ONLINE]
# The second lane runs these, so that both lanes take about as long.
APART = [
    *(f"test/unit/{name}" for name in ("papers", "identify", "fleet", "optimization", "report")),
    "test/packaging",
]
MEASURE = ["--cov-report=", f"--cov-report=json:{COVERAGE}"]
TESTS = {
    "online tests": [
        *("-c", "test/pytest.ini", *FOLDERS),
        *(f"--cov=robot_energy.{name}" for name in ONLINE),
        *MEASURE,
    ],
    "tests": [
        *("-c", "test/pytest.ini", "test"),
        *(f"--ignore={folder}" for folder in (*FOLDERS, *APART)),
    ],
    "offline tests": ["-c", "test/pytest.ini", *APART],
    "node tests": ["-c", "ros2_energy_monitor/setup.cfg", "ros2_energy_monitor/test"],
}
WHOLE = {"coverage": ["-c", "test/pytest.ini", "test", "--cov=robot_energy", *MEASURE]}


@dataclass
class Lane:
    """Stages that run one after the other.

    Attributes:
        output: Where their output goes; None for the terminal.
        words: What became of each stage.
        counts: Tests by outcome.
    """

    output: IO[str] | None = None
    words: list[str] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)

    def lint(self) -> None:
        """Check format, lint and types."""
        for name, commands in LINT.items():
            codes = [run(name, command, self.output) for command in commands]
            self.words.append(f"{name} {'FAILED' if any(codes) else 'ok'}")

    def test(self, stages: dict[str, list[str]]) -> None:
        """Run the test processes with these names and arguments."""
        for name, paths in stages.items():
            domain = domain_id([*TESTS, *WHOLE].index(name))
            code, count = run_pytest(name, paths, domain, self.output)
            self.words.append(f"{name} {'FAILED' if code else 'ok'}")
            self.counts += count


def main(arguments: list[str]) -> int:
    """Run the stages, print the summary, return the exit code."""
    started = time.monotonic()
    STOPPED.clear()
    lane = Lane()
    lanes = [lane]
    if "--lint" not in arguments:
        COVERAGE.unlink(missing_ok=True)
    if "--lint" in arguments:
        lane.lint()
    elif "--coverage" in arguments:
        lane.test(WHOLE)
    elif (os.cpu_count() or 1) == 1:
        lane.lint()
        lane.test(TESTS)
    else:
        first = {name: paths for name, paths in TESTS.items() if name == "tests"}
        nodes = {name: paths for name, paths in TESTS.items() if name == "node tests"}
        second = {name: paths for name, paths in TESTS.items() if name not in first | nodes}
        with ExitStack() as stack:
            outputs = [stack.enter_context(tempfile.TemporaryFile("a+", errors="replace"))
                       for _ in range(2)]  # fmt: skip
            pool = stack.enter_context(ThreadPoolExecutor())
            computing, waiting = map(Lane, outputs)
            lanes += [computing, waiting]
            parallel = [
                pool.submit(lambda: (computing.lint(), computing.test(second))),
                pool.submit(lambda: waiting.test(nodes)),
            ]
            try:
                lane.test(first)
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
    words = [word for each in reversed(lanes) for word in each.words]
    counts = sum((each.counts for each in lanes), Counter[str]())
    if "--lint" not in arguments:
        words.append(coverage(COVERAGE))
    print(f"\n{', '.join(words)} in {time.monotonic() - started:.0f} s")
    if "--lint" not in arguments:
        skipped = f", {counts['skipped']} skipped" if counts["skipped"] else ""
        print(f"{counts['passed']} passed, {counts['failed']} failed{skipped}")
    return 1 if any(word.endswith("FAILED") for word in words) else 0


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
        # Python 3.12 counts lines by sys.monitoring, which costs less.
        **({"COVERAGE_CORE": "sysmon"} if sys.version_info >= (3, 12) else {}),
        OPENBLAS_NUM_THREADS="1",  # two lanes share the processors
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
    # A session of its own, so that a hanging stage ends with all its children.
    process = subprocess.Popen(
        command,
        cwd=ROOT,
        env=os.environ | settings,
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
