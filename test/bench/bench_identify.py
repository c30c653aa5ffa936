"""Identification of a real robot's dynamics, next to FIGAROH from PyPI on the same files.

Needs the recordings: ``ROBOT_ENERGY_DATA`` names their folder. FIGAROH is installed into an
environment of its own under build/ the first time.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
from pathlib import Path

from rich.table import Table

HERE = Path(__file__).parent
REQUIREMENTS = HERE / "requirements-figaroh.txt"
MAPPING_LINES = len((HERE.parents[1] / "src/examples/identify/tx40.yaml").read_text().splitlines())
INSTALL_LIMIT = 900.0  # s


def figaroh_python(folder: Path) -> tuple[Path | None, str]:
    """Return the interpreter of FIGAROH's environment, made on demand, or why there is none."""
    environment = folder / "figaroh"
    python, stamp = environment / "bin" / "python", environment / "complete"
    wanted = REQUIREMENTS.read_text()
    if stamp.exists() and stamp.read_text() == wanted:
        return python, ""
    pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    for command in (
        [sys.executable, "-m", "venv", "--clear", str(environment)],
        [*pip, "setuptools", "wheel"],
        [*pip, "--no-deps", "--no-build-isolation", "-r", str(REQUIREMENTS)],
    ):
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=INSTALL_LIMIT, check=False
            )
        except subprocess.TimeoutExpired:
            return None, f"its installation took over {INSTALL_LIMIT:.0f} s"
        if done.returncode:
            return None, (done.stderr.strip().splitlines() or ["pip failed"])[-1]
    stamp.write_text(wanted)
    return python, ""


def measure(python: Path | str, script: str, data: Path, **changes: str) -> dict[str, float]:
    """Run a script in its own process, one thread; its figures."""
    done = subprocess.run(
        [str(python), str(HERE / script), str(data)],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", **changes},
    )
    return json.loads(done.stdout.strip().splitlines()[-1])


def run(folder: Path, quick: bool) -> tuple[Table, dict[str, object], dict[str, bool]]:
    """Identify with both and compare."""
    table = Table(title="dynamics of a Staubli TX40, 9 s at 5 kHz, one thread")
    for column in (
        "program",
        "base",
        "s",
        "CPU s",
        "MB",
        "in sample",
        "held out",
        "friction",
        "user writes",
    ):
        table.add_column(
            column, justify="left" if column in ("program", "user writes") else "right"
        )
    data = Path(os.environ.get("ROBOT_ENERGY_DATA", "/nonexistent")) / "tx40"
    if not data.is_dir():
        table.add_row("skipped: no data folder (set ROBOT_ENERGY_DATA)", *[""] * 8)
        return table, {"skipped": "no data folder"}, {}
    runs = [measure(sys.executable, "ours_tx40.py", data) for _ in range(1 if quick else 5)]
    ours = {key: statistics.median(run[key] for run in runs) for key in runs[0]}
    table.add_row(
        "robot-energy identify dynamics",
        f"{ours['base']:.0f} ({ours['inertial']:.0f} inertial)",
        f"{ours['wall']:.2f}",
        f"{ours['cpu']:.2f}",
        f"{ours['peak_mb']:.0f}",
        f"{ours['in_sample']:.2%}",
        f"{ours['held_out']:.2%}",
        f"within {ours['friction_deviation']:.1%}",
        f"{MAPPING_LINES} lines of YAML",
    )
    figures: dict[str, object] = {"ours": ours}
    folder.mkdir(parents=True, exist_ok=True)
    python, why = figaroh_python(folder)
    if python is None:
        table.add_row(f"FIGAROH cannot be installed here: {why}", *[""] * 8)
        figures["figaroh"] = why
    else:
        clean = {"PYTHONPATH": "", "LD_LIBRARY_PATH": ""}
        other = measure(python, "figaroh_tx40.py", data, **clean)
        lines = len((HERE / "figaroh_tx40.py").read_text().splitlines())
        table.add_row(
            "FIGAROH 0.2.4, OLS, sides aligned by hand",
            f"{other['base']:.0f}",
            f"{other['wall']:.2f}",
            f"{other['cpu']:.2f}",
            f"{other['peak_mb']:.0f}",
            f"{other['in_sample']:.2%}",
            f"{other['held_out']:.2%}",
            "",
            f"{lines} lines of Python and YAML",
        )
        figures["figaroh"] = other
    goals = {
        f"61 base parameters, 36 inertial: {ours['base']:.0f}, {ours['inertial']:.0f}": (
            ours["base"],
            ours["inertial"],
        )
        == (61, 36),
        f"friction within 5 % of the reference: {ours['friction_deviation']:.1%}": ours[
            "friction_deviation"
        ]
        <= 0.05,
        f"held out, standstill too, at most 8.2 %: {ours['held_out']:.2%}": ours["held_out"]
        <= 0.082,
        f"raw files to model in 0.4 s: {ours['wall']:.2f} s ({ours['cpu']:.2f} s of CPU)": ours[
            "wall"
        ]
        <= 0.4,
        f"at most 400 MB: {ours['peak_mb']:.0f}": ours["peak_mb"] <= 400,
        f"at most 30 lines of YAML: {MAPPING_LINES}": MAPPING_LINES <= 30,
    }
    return table, figures, goals
