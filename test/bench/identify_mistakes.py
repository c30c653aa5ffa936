"""How often identification refuses deliberate mistakes, and how often it refuses a sound recording.

    ROBOT_ENERGY_DATA=... python test/bench/identify_mistakes.py [--quick]

Sound: recordings of the virtual rig, of three robots, and real ones where ``ROBOT_ENERGY_DATA``
names their folder. Spoiled: those of the rig, each with every mistake. Each runs through the
commands; what is refused must write nothing. "Refused" are results that a gate calls implausible,
not recordings that lack something. Where the model file says that the masses of its URDF are
assumed, scales are not refused by design; those robots have rows of their own. ``--quick`` tries
the script: dynamics and cabinet of one recording of the KR 16, with one mistake of each.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import yaml
from rich.console import Console

sys.path.insert(0, str(Path(__file__).parent.parent))

from mistakes import mistakes, rewrite
from robot_energy.foundation.errors import ImplausibleIdentificationError, RobotEnergyError
from robot_energy.model import RobotModel, load
from robot_energy_cli.main import main as command
from robot_energy_identify.refused_recordings import bodies_known
from robot_energy_report.printing import table

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "src/examples"
SECONDS = 20.0  # of each recording of the rig
TORQUE = ("sign of one torque", "sign of one joint", "sign of all torques", "torque scale sqrt 2",
          "two joints exchanged")  # fmt: skip
METER = ("meter sign", "meter in kW")
SUBJECTS = ("dynamics", "friction", "all")


def run(words: list[str], folder: Path) -> tuple[bool, str]:
    """Whether a command is refused as implausible, and its error; then nothing is written."""
    files = [folder / "out.yaml", folder / "out.json"]
    more = [] if "--log" in words and words[0] != "dynamics" else ["--out", str(files[0])]
    said = ""
    quiet = io.StringIO()
    try:
        with contextlib.redirect_stderr(quiet), contextlib.redirect_stdout(quiet):
            assert not command(["identify", *words, *more, "--json", str(files[1]), "--debug"])
    except RobotEnergyError as error:
        said = f"{type(error).__name__}: {error}"
    written = [path for path in files if path.exists()]
    assert not (said and written), f"{words} refused but wrote {written}"
    for path in written:
        path.unlink()
    return said.startswith(ImplausibleIdentificationError.__name__), said


def gear_halved(model: RobotModel, joint: int, folder: Path) -> str:
    """Model file with one gear ratio halved."""
    data = model.model_dump(exclude_none=True, mode="json")
    data["urdf"].pop("path", None)
    data["urdf"]["xml"] = model.urdf_xml
    data["joints"][joint]["gear_ratio"]["value"] *= 0.5
    path = folder / "halved.yaml"
    path.write_text(yaml.safe_dump(data))
    return str(path)


def rig(folder: Path, robots: list[str], quick: bool) -> Iterator[tuple[str, Path]]:
    """Recordings of the rig, cold and warm; one of the first robot to try the script."""
    for robot in robots[:1] if quick else robots:
        for seed, degc in enumerate(("20",) if quick else ("20", "60")):
            bag = folder / f"{robot}_{degc}"
            words = ["simulate", "--robot", robot, "--duration", str(SECONDS), "--seed", str(seed)]
            with contextlib.redirect_stdout(io.StringIO()):
                assert not command([*words, "--start-temperature", degc, "--out", str(bag)])
            yield robot, bag
    for name in () if quick else ("kr16_cold", "kr16_warm"):
        yield "kr16", ROOT / "bags" / name


def real() -> dict[str, list[str]]:
    """Identifications of real recordings, by name; empty without the data."""
    data = Path(os.environ.get("ROBOT_ENERGY_DATA", "/nonexistent"))
    if not data.is_dir():
        return {}
    maps, logs = EXAMPLES / "mappings", sorted(map(str, (data / "rad_ur3e").glob("L*.csv")))
    xarm = str(data / "xarm6_j3" / "no_payload.csv.gz")
    voraus = str(data / "voraus" / "test.parquet")
    return {
        "KR 300 dynamics": [
            "dynamics", "--log", str(data / "kr300"),
            "--mapping", str(EXAMPLES / "identify" / "kr300.yaml")],
        "TX40 dynamics": [
            "dynamics", "--log", str(data / "tx40"),
            "--mapping", str(EXAMPLES / "identify" / "tx40.yaml")],
        "xArm 6 friction": [
            "friction", "--log", xarm, "--mapping", str(maps / "xarm6_joint3.yaml")],
        "UR3e drives": ["drives", *logs, "--ur-rtde", "--model", "ur3e"],
        "Yu-Cobot drives": ["drives", "--log", voraus, "--mapping", str(maps / "voraus.yaml")],
    }  # fmt: skip


def main() -> int:
    """Print the counts; exit code 1 if a sound recording is refused."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", nargs="+", default=["kr16", "irb4600", "testbed"])
    parser.add_argument("--joint", type=int, default=2, help="with the mistakes, from 0")
    parser.add_argument("--quick", action="store_true", help="short, for trying the script only")
    args = parser.parse_args()
    subjects = SUBJECTS[:1] if args.quick else SUBJECTS
    torque, meter = (TORQUE[:1], METER[:1]) if args.quick else (TORQUE, METER)
    rows: dict[tuple[str, str], list[bool]] = {}
    wrong = 0

    def note(what: str, words: list[str], expected: bool, kind: str) -> None:
        nonlocal wrong
        refused, said = run(words, folder)
        wrong += refused and not expected
        rows.setdefault((what, kind), []).append(refused)
        if refused is not expected:
            print(f"{what}, {kind}, {' '.join(words)}: {said or 'passed'}", flush=True)

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for label, words in ({} if args.quick else real()).items():
            note("sound", words, False, f"real: {label}")
        for robot, bag in rig(folder, args.robots, args.quick):
            model = load(robot)
            joint = min(args.joint, len(model.joints) - 2)
            kind = "rig, masses known" if bodies_known(model) else "rig, masses assumed"
            common = ["--model", robot, "--effort", "motor_torque"]
            for subject in (*subjects, "cabinet"):
                test = ["--no-test"] if subject == "all" else []
                used = common[:2] if subject == "cabinet" else common
                note("sound", [subject, str(bag), *used, *test], False, kind)
            halved = gear_halved(model, joint, folder)
            for subject in subjects:
                test = ["--no-test"] if subject == "all" else []
                words = [subject, str(bag), "--model", halved, *common[2:], *test]
                note("gear ratio halved", words, True, kind)
            cases = mistakes(joint, joint + 1, len(model.joints))
            for what in (*torque, *meter):
                case = cases[what]
                spoiled = rewrite(bag, folder / f"{bag.name} {what}", case.states, case.meter)
                for subject in subjects if what in TORQUE else ("cabinet", "all")[: len(subjects)]:
                    test = ["--no-test"] if subject == "all" else []
                    used = common[:2] if subject == "cabinet" else common
                    note(what, [subject, str(spoiled), *used, *test], True, kind)
    page = Console(width=120)
    table(
        page,
        "Identifications refused as implausible, nothing written",
        ("recording", "of", "refused"),
        [(what, which, f"{sum(seen)} of {len(seen)}") for (what, which), seen in rows.items()],
    )
    return int(bool(wrong))


if __name__ == "__main__":
    raise SystemExit(main())
