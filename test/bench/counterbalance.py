"""Gas spring at the second axis of a robot of the KR 300's size: torque with and without a term.

    python test/bench/counterbalance.py [--plants 4]

Drawn plants of the virtual rig with every effect (simulated) on the kinematics and starting bodies
of the KR 300, with a gas spring at axis 2. Each is identified from 20 s of motion, without a
counterbalance and with each kind whose strength is open, and predicts the torque of another
motion. Errors are those of the model file: norm of the error over that of the torque, axis 2.
"""

from __future__ import annotations

import argparse
import math
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

from rich.console import Console

sys.path.insert(0, str(Path(__file__).parent.parent))

from places import ROOT
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel, load, save
from robot_energy.model.joint import Joint
from robot_energy.timeline.blocks import EffortMeaning
from robot_energy_identify.data.log_channels import model_of
from robot_energy_identify.data.observations import Channels, stretches
from robot_energy_identify.data.recordings import read_recording
from robot_energy_identify.dynamics.dynamics import identify_dynamics
from robot_energy_identify.dynamics.validation import torque_error
from robot_energy_identify.excitation.excitation import ExcitationSettings, optimise_excitation
from robot_energy_identify.excitation.limits import ExcitationLimits
from robot_energy_logs.mapping import load_mapping
from robot_energy_papers.mantis import recorded
from robot_energy_report.printing import table
from robot_energy_rig import RigConfig, random_profile

CONSOLE = Console(width=110)
MAPPING = ROOT / "src/examples/identify/kr300.yaml"
EFFORT = (12e3, 15e3, 9e3, 3e3, 3e3, 2e3)  # N m, of the joints: of the size of such a robot
AXIS, SECONDS, RATE = 1, 20.0, 250.0
GAS = {"a": 0.25, "b": 0.6, "angle": math.pi / 2, "force": 15e3, "rate": 20e3, "length": 0.85}
OPEN: dict[str, dict[str, Any]] = {
    "none": {},
    "spring": {"kind": "spring", "stiffness": 0.0, "rest": -math.pi / 2},
    "lever": {"kind": "lever", "moment": 0.0, "angle": 0.0},
    "gas spring of known geometry": {"kind": "gas_spring", **GAS, "force": 0.0, "rate": 0.0},
}


def with_spring(model: RobotModel, entry: dict[str, Any]) -> RobotModel:
    """Return the model with a counterbalance of axis 2, or none; its figures are assumed."""
    figures = {
        key: value if key == "kind" else {"value": value, "tag": "assumed"}
        for key, value in entry.items()
    }
    joints = list(model.joints)
    given = joints[AXIS].model_dump(exclude_none=True) | {"counterbalance": figures or None}
    joints[AXIS] = Joint.model_validate(given)
    return model.changed(joints=joints)


def large_robot(folder: Path) -> RobotModel:
    """Return the KR 300 of the mapping with limits of effort and a gas spring, from a file."""
    model = model_of(load_mapping(MAPPING), [MAPPING.parent])
    efforts = iter(EFFORT)
    xml = re.sub('effort="0"', lambda _: f'effort="{next(efforts):g}"', model.urdf_xml, count=6)
    model = model.model_copy(update={"urdf": model.urdf.model_copy(update={"xml": xml})})
    save(
        with_spring(model.with_urdf(xml, "kr300"), {"kind": "gas_spring", **GAS}),
        folder / "kr.yaml",
    )
    return load(folder / "kr.yaml")


def channels(model: RobotModel, seed: int, folder: Path) -> list[list[Channels]]:
    """Return two recorded motions of one drawn plant."""
    profile = random_profile(str(folder / "kr.yaml"), seed)
    limits, parts = ExcitationLimits(model, profile.acceleration), []
    for number in (1, 2):
        settings = ExcitationSettings(
            harmonics=5, period=SECONDS, starts=1, iterations=15, seed=number
        )
        motion = optimise_excitation(model, limits, settings).motion
        path = folder / f"{seed}_{number}"
        recorded(profile, motion, SECONDS, path, number, RigConfig.hard(), RATE)
        torque = read_recording(path, model, EffortMeaning.MOTOR_TORQUE).torque
        position, measured = torque.joint_position, torque.motor_torque_measured
        parts.append(stretches(torque.stamp_ns, torque.segment, position, measured, None))
    return parts


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--plants", type=int, default=4)
    plants = range(1, parser.parse_args().plants + 1)
    found: dict[str, list[str]] = {name: [name] for name in OPEN}
    with tempfile.TemporaryDirectory() as name:
        model = large_robot(Path(name))
        start = with_spring(model, {})
        for seed in plants:
            train, test = channels(start, seed, Path(name))
            for kind, entry in OPEN.items():
                try:
                    fit = identify_dynamics(train, with_spring(start, entry))
                except NotIdentifiableError:
                    found[kind].append("refused")
                    continue
                rows = fit.rows_of(test)
                error = torque_error(rows, fit.predict(rows)).joint[AXIS]
                found[kind].append(f"{100 * error:.2f} %")
    title = "Torque error of axis 2 on another motion (simulated)"
    columns = ["counterbalance", *(f"plant {seed}" for seed in plants)]
    table(CONSOLE, title, columns, list(found.values()))


if __name__ == "__main__":
    main()
