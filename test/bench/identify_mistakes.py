"""How often identification refuses deliberate mistakes, and how often it refuses a sound recording.

    ROBOT_ENERGY_DATA=... python test/bench/identify_mistakes.py

Sound: recordings of the virtual rig, of three robots, and real ones where ``ROBOT_ENERGY_DATA``
names their folder. Spoiled: those of the rig, each with every mistake. Each runs through the
commands; what is refused must write nothing.
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
from robot_energy.cli.main import main as command
from robot_energy.model import RobotModel, load
from robot_energy.report.printing import table

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "src/examples"
SECONDS = 20.0  # of each recording of the rig
REFUSED = 2
TORQUE = ("sign of one torque", "sign of one joint", "sign of all torques", "torque scale sqrt 2",
          "two joints exchanged")  # fmt: skip
METER = ("meter sign", "meter in kW")
SUBJECTS = ("dynamics", "friction", "all")


def run(words: list[str], folder: Path) -> tuple[int, str]:
    """Exit code and error of one command; what is refused has written nothing."""
    out, err = folder / "out.yaml", io.StringIO()
    more = [] if "--log" in words and words[0] != "dynamics" else ["--out", str(out)]
    with contextlib.redirect_stderr(err), contextlib.redirect_stdout(io.StringIO()):
        code = command(["identify", *words, *more, "--json", str(folder / "out.json")])
    written = [path for path in (out, folder / "out.json") if path.exists()]
    assert not (code and written), f"{words} refused but wrote {written}"
    for path in written:
        path.unlink()
    return code, err.getvalue().strip()


def gear_halved(model: RobotModel, joint: int, folder: Path) -> str:
    """Model file with one gear ratio halved."""
    data = model.model_dump(exclude_none=True, mode="json")
    data["urdf"].pop("path", None)
    data["urdf"]["xml"] = model.urdf_xml
    data["joints"][joint]["gear_ratio"]["value"] *= 0.5
    path = folder / "halved.yaml"
    path.write_text(yaml.safe_dump(data))
    return str(path)


def rig(folder: Path, robots: list[str]) -> Iterator[tuple[str, Path]]:
    """Recordings of the rig, cold and warm."""
    for robot in robots:
        for seed, degc in enumerate(("20", "60")):
            bag = folder / f"{robot}_{degc}"
            words = ["simulate", "--robot", robot, "--duration", str(SECONDS), "--seed", str(seed)]
            with contextlib.redirect_stdout(io.StringIO()):
                assert not command([*words, "--start-temperature", degc, "--out", str(bag)])
            yield robot, bag
    for name in ("kr16_cold", "kr16_warm"):
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
    parser.add_argument("--robots", nargs="+", default=["kr16", "ur5e", "mantis"])
    parser.add_argument("--joint", type=int, default=2, help="with the mistakes, from 0")
    args = parser.parse_args()
    rows: dict[tuple[str, str], list[bool]] = {}
    wrong = 0

    def note(what: str, which: str, code: int, said: str, right: bool) -> None:
        rows.setdefault((what, which), []).append(code == REFUSED)
        if not right:
            print(f"{what}, {which}: {code} {said}", flush=True)

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for label, words in real().items():
            code, said = run(words, folder)
            wrong += bool(code)
            note("sound, real", label, code, said, not code)
        for robot, bag in rig(folder, args.robots):
            model = load(robot)
            common = ["--model", robot, "--effort", "motor_torque"]
            for subject in (*SUBJECTS, "cabinet"):
                test = ["--no-test"] if subject == "all" else []
                used = common[:2] if subject == "cabinet" else common
                code, said = run([subject, str(bag), *used, *test], folder)
                unfit = code and "nothing" not in said and "not" not in said
                wrong += bool(code) and bool(unfit)
                note("sound, rig", f"identify {subject}", code, said, not code)
            halved = gear_halved(model, args.joint, folder)
            for subject in SUBJECTS:
                test = ["--no-test"] if subject == "all" else []
                code, said = run([subject, str(bag), "--model", halved, *common[2:], *test], folder)
                note("gear ratio halved", f"identify {subject}", code, said, bool(code))
            cases = mistakes(args.joint, args.joint + 1, len(model.joints))
            for what in (*TORQUE, *METER):
                _, states, meter = cases[what]
                spoiled = rewrite(bag, folder / f"{bag.name} {what}", states, meter)
                for subject in SUBJECTS if what in TORQUE else ("cabinet", "all"):
                    test = ["--no-test"] if subject == "all" else []
                    used = common[:2] if subject == "cabinet" else common
                    code, said = run([subject, str(spoiled), *used, *test], folder)
                    note(what, f"identify {subject}", code, said, bool(code))
    page = Console(width=120)
    table(
        page,
        "Refused with exit code 2, nothing written",
        ("recordings", "identification", "refused"),
        [(what, which, f"{sum(seen)} of {len(seen)}") for (what, which), seen in rows.items()],
    )
    return int(bool(wrong))


if __name__ == "__main__":
    raise SystemExit(main())
