"""URDFs and xacro files of others: each through `model init`, `model check` and a short replay.

Usage: ``python test/soak/urdfs.py FOLDER [--log FILE]``, for any folder of such files. ``make
soak`` runs it on what `.ci/requirements-urdfs.txt` lists.

The joint states are sines, worked out here. Torque and energy are compared with those of
Pinocchio, which reads the file itself.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import re
import shutil
import sys
import tempfile
import time
import traceback
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from hashlib import sha256
from importlib import import_module
from pathlib import Path

import numpy as np
import pinocchio
from figure import Figure
from rich.console import Console
from rich.table import Table

from robot_energy.bag import BagWriter
from robot_energy.bag.cdr import Encoder, stamp_columns
from robot_energy.model import RobotModel, load
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import Float
from robot_energy_cli import main

ROOT = Path(__file__).resolve().parents[2]
LISTED = ROOT / "build/urdfs"
QUICK = 20  # files with --quick
MINUTES = (4.0, 1.0)
RATE, DURATION = 250.0, 2.0  # Hz, s
WAIT = 300.0  # s for one file
TORQUE, ENERGY = 1e-8, 2e-3  # difference from Pinocchio, shares of the greatest of the robot
USED = (
    *("robot_energy.replay.api", "robot_energy_cli.models", "robot_energy_cli.replay"),
    *("robot_energy_report.model", "robot_energy_report.replay", "robot_energy_identify.starter"),
)
JOINT_STATE = "sensor_msgs/msg/JointState"
EQUAL, ALONE = "used, as Pinocchio", "used, Pinocchio refuses it"
FAILED = ("unexpected error", "silent zero", "differs from Pinocchio", "no reason", "no answer")


@dataclass
class Outcome:
    """What became of one file.

    Attributes:
        path: The file.
        kind: `EQUAL`, `ALONE`, a refusal or one of `FAILED`.
        detail: What was printed, or by how much it differs.
        joints: Modelled joints.
        torque: Greatest difference from Pinocchio. [share of the greatest torque]
        energy: Likewise, of the rigid-body energy of a joint, rotors included.
    """

    path: str
    kind: str
    detail: str = ""
    joints: int = 0
    torque: float = 0.0
    energy: float = 0.0


def run(folder: str, quick: bool) -> list[Figure]:
    """Try what `.ci/requirements-urdfs.txt` lists."""
    files = find_files(LISTED)
    some = files[:: max(1, len(files) // QUICK)] if quick else files
    outcomes = try_files(some, Path(folder) / "urdfs.jsonl")
    show(outcomes)
    used = [outcome for outcome in outcomes if outcome.kind == EQUAL]
    return [
        Figure("URDFs and xacro files of others", len(outcomes), "some", bool(outcomes)),
        Figure("of them as Pinocchio reads them", len(used), "some", bool(used)),
        *(
            Figure(kind, sum(outcome.kind == kind for outcome in outcomes), "0", kind not in found)
            for found in [{outcome.kind for outcome in outcomes}]
            for kind in FAILED
        ),
    ]


def find_files(folder: Path) -> list[Path]:
    """Return the URDFs and xacro files below a folder, each content once."""
    found: dict[str, Path] = {}
    for path in sorted(folder.rglob("*")):
        if path.suffix.lower() in (".urdf", ".xacro") and path.is_file():
            found.setdefault(sha256(path.read_bytes()).hexdigest(), path)
    return sorted(found.values(), key=lambda path: path.suffix)


def try_files(files: list[Path], log: Path | None = None) -> list[Outcome]:
    """Try each file in a process of its own, as many at a time as there are cores.

    Args:
        files: URDFs and xacro files.
        log: Where each outcome is written as a line of JSON as soon as it is known.
    """
    for name in USED:  # once, and not in each process
        import_module(name)
    outcomes: list[Outcome] = []
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for outcome in pool.map(_apart, files):
            outcomes.append(outcome)
            if log is not None:
                with log.open("a") as file:
                    file.write(json.dumps(asdict(outcome)) + "\n")
    return outcomes


def _apart(path: Path) -> Outcome:
    fork = multiprocessing.get_context("fork")
    receiver, sender = fork.Pipe(duplex=False)
    folder = Path(tempfile.mkdtemp(prefix="urdfs_"))
    process = fork.Process(target=_report, args=(path, folder, sender))
    process.start()
    sender.close()
    try:
        if receiver.poll(WAIT):
            return receiver.recv()
        return Outcome(str(path), "no answer", f"within {WAIT:g} s")
    except EOFError:
        process.join()
        return Outcome(str(path), "unexpected error", f"ended with {process.exitcode}")
    finally:
        process.kill()
        process.join()
        shutil.rmtree(folder, ignore_errors=True)


def _report(path: Path, folder: Path, sender: multiprocessing.connection.Connection) -> None:
    try:
        outcome = _try(path, folder)
    except Exception:
        outcome = Outcome(str(path), "unexpected error", traceback.format_exc())
    sender.send(outcome)
    sender.close()


def _try(path: Path, folder: Path) -> Outcome:
    """Make a model, check it, replay a bag with it and compare."""
    model_file, result_file = folder / "model.yaml", folder / "result.json"
    code, said = _command(folder, "model", "init", path, "--out", model_file)
    if code == 2:
        return Outcome(str(path), refusal(said, path), said)
    if code:
        return Outcome(str(path), "unexpected error", said)
    code, said = _command(folder, "model", "check", model_file)
    if code:
        return Outcome(str(path), "unexpected error", f"model check: {said}")
    model = load(model_file)
    robot = Robot.from_model(model)
    time_s, motion = sines(robot)
    write_bag(folder / "bag", time_s, robot.joint_names, motion)
    code, said = _command(
        folder, "replay", folder / "bag", "--model", model_file, "--json", result_file
    )
    if code:
        return Outcome(str(path), "unexpected error", f"replay: {said}")
    result = json.loads(result_file.read_text())
    joints = len(robot.joint_names)
    if not (result["energy"]["grid_import"] > 0 and result["time"]["coverage"] > 0.9):
        return Outcome(str(path), "silent zero", said, joints)
    try:
        torque = independent_torque(model, robot.joint_names, motion)
    except ValueError as error:
        return Outcome(str(path), ALONE, str(error), joints)
    largest = float(np.abs(torque).max())
    off = float(np.abs(robot.joint_torque(*motion) - torque).max()) / largest if largest else 0.0
    power = torque * motion[1]
    lifted = np.sum((power[1:] + power[:-1]) / (2 * RATE), axis=0)
    found = np.array([joint["rigid_energy"] for joint in result["joints"]])
    rotors = kinetic_energy_of_rotors(model, motion[1])
    found -= rotors[-1] - rotors[0]
    scale = float((np.abs(power).sum(axis=0) / RATE + rotors.max(axis=0)).max())
    energy = float(np.abs(found - lifted).max()) / scale if scale else 0.0
    kind = EQUAL if off < TORQUE and energy < ENERGY else "differs from Pinocchio"
    return Outcome(str(path), kind, f"torque {off:.1e}, energy {energy:.1e}", joints, off, energy)


def _command(folder: Path, *words: object) -> tuple[int, str]:
    """Run a command as typed, in this process; return its exit code and what it printed."""
    output = folder / "printed.txt"
    sys.stdout.flush()
    with output.open("w") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
        code = main([str(word) for word in words])
        sys.stdout.flush()
        sys.stderr.flush()
    return code, output.read_text(errors="replace").strip()


def refusal(said: str, path: Path) -> str:
    """Return the kind of a refusal: its reason without names and figures."""
    text = said.splitlines()[-1].removeprefix("robot-energy: ") if said else ""
    reason, expected, _ = text.partition("; expected")
    if not reason or not expected:
        return "no reason"
    reason = reason.replace(str(path), "FILE")
    reason = re.sub(r"^xacro cannot expand FILE: (.{60}).*", r"xacro: \1", reason)
    reason = re.sub(r"'[^']*'|\"[^\"]*\"", "NAME", reason)
    reason = re.sub(r"(/[\w.+-]+)+", "FILE", reason)
    reason = re.sub(r"\S*\d\S*", "N", reason)
    return "refused: " + re.sub(r"(: )?(NAME|N)(,? (NAME|N|and))*", r"\1\2", reason)[:90]


def sines(robot: Robot) -> tuple[Float, tuple[Float, Float, Float]]:
    """Return times and a motion within the limits: position, velocity, acceleration."""
    limits = robot.limits
    time_s = np.arange(round(RATE * DURATION)) / RATE
    low = np.where(np.isfinite(limits.lower), limits.lower, -np.inf)
    high = np.where(np.isfinite(limits.upper), limits.upper, np.inf)
    middle = np.where(np.isfinite(low) & np.isfinite(high), 0.5 * (low + high), 0.0)
    middle = np.clip(np.clip(middle, -1.0, 1.0), low, high)
    room = np.minimum(high - middle, middle - low)
    rate = 0.9 + 1.4 * np.arange(robot.n_joints) / robot.n_joints  # rad/s
    swing = np.minimum(np.minimum(0.4 * limits.velocity / rate, 0.9 * room), 0.5)
    phase = time_s[:, None] * rate + np.arange(robot.n_joints)
    return time_s, (
        middle + swing * np.sin(phase),
        swing * rate * np.cos(phase),
        -swing * rate**2 * np.sin(phase),
    )


def write_bag(
    path: Path, time_s: Float, names: tuple[str, ...], motion: tuple[Float, Float, Float]
) -> None:
    """Write joint states as `ros2 bag record` leaves them."""
    size = len(names)
    encoder = Encoder(
        JOINT_STATE, {"name": names}, {"position": size, "velocity": size, "effort": 0}
    )
    stamp = 1_700_000_000 * 10**9 + np.rint(time_s * 1e9).astype(np.int64)
    with BagWriter(path) as bag:
        bag.add_topic("/joint_states", JOINT_STATE)
        columns = {**stamp_columns(stamp), "position": motion[0], "velocity": motion[1]}
        columns["effort"] = np.empty((len(stamp), 0))
        bag.write("/joint_states", stamp, encoder.encode(columns, len(stamp)))


def independent_torque(
    model: RobotModel, names: tuple[str, ...], motion: tuple[Float, Float, Float]
) -> Float:
    """Return the torque of Pinocchio, which reads the URDF as it is; other joints stand at 0.

    Raises:
        ValueError: If Pinocchio refuses the URDF.
    """
    whole = pinocchio.buildModelFromXML(model.urdf_xml)
    data = whole.createData()
    bodies = [whole.joints[whole.getJointId(name)] for name in names]
    rows: list[Float] = []
    for position, velocity, acceleration in zip(*motion, strict=True):
        q, v, a = pinocchio.neutral(whole), np.zeros(whole.nv), np.zeros(whole.nv)
        for body, x, rate, change in zip(bodies, position, velocity, acceleration, strict=True):
            q[body.idx_q : body.idx_q + body.nq] = x if body.nq == 1 else (np.cos(x), np.sin(x))
            v[body.idx_v], a[body.idx_v] = rate, change
        whole.gravity.linear = np.asarray(model.gravity)
        tau = pinocchio.rnea(whole, data, q, v, a)
        rows.append(np.array([tau[body.idx_v] for body in bodies]))
    return np.array(rows)


def kinetic_energy_of_rotors(model: RobotModel, velocity: Float) -> Float:
    """Return the energy of each rotor at each sample: the bodies of the URDF lack them. [J]"""
    inertia = np.array([joint.rotor_inertia.value for joint in model.joints])
    ratio = np.array([joint.gear_ratio.value for joint in model.joints])
    return 0.5 * inertia * ratio**2 * velocity**2


def show(outcomes: list[Outcome]) -> None:
    """Print a table of the kinds of outcomes."""
    table = Table("outcome", "files", "example", title=f"{len(outcomes)} files of others")
    counts = Counter(outcome.kind for outcome in outcomes)
    for kind, count in counts.most_common():
        example = next(outcome.path for outcome in outcomes if outcome.kind == kind)
        table.add_row(kind, str(count), "/".join(Path(example).parts[-3:]))
    console = Console(width=160)
    console.print(table, markup=False, highlight=False)
    for outcome in outcomes:
        if outcome.kind in FAILED:
            console.print(f"{outcome.kind}: {outcome.path}: {outcome.detail}", markup=False)


def _main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--log", type=Path, help="write every outcome as a line of JSON")
    words = parser.parse_args()
    begin = time.monotonic()
    outcomes = try_files(find_files(words.folder), words.log)
    show(outcomes)
    same = [outcome for outcome in outcomes if outcome.kind == EQUAL]
    print(
        f"{len(same)} as Pinocchio: torque within {max((o.torque for o in same), default=0):.1e}, "
        f"energy within {max((o.energy for o in same), default=0):.1e}; "
        f"{sum(o.kind in FAILED for o in outcomes)} failures; {time.monotonic() - begin:.0f} s"
    )
    return int(any(outcome.kind in FAILED for outcome in outcomes))


if __name__ == "__main__":
    sys.exit(_main())
