"""How often each gate of identification is right, on the virtual rig: a table.

    python test/soak/plausibility.py --seeds 3

Every plant is recorded cold and warm; each row spoils the recordings or the model in one way.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from robot_energy.foundation.errors import ImplausibleIdentificationError, NotIdentifiableError
from robot_energy.model import RobotModel, load
from robot_energy.timeline.blocks import EffortMeaning
from robot_energy_identify.data.recordings import Recording, channels_of, read_recording
from robot_energy_identify.dynamics.dynamics import identify_dynamics
from robot_energy_identify.friction.friction import fit_axes
from robot_energy_identify.friction.samples import friction_data
from robot_energy_identify.plausibility import check_dynamics, check_friction, check_signs
from robot_energy_plan.motion import random_program
from robot_energy_report.printing import table
from robot_energy_rig import RigConfig, VirtualRig, load_profile
from robot_energy_rig.record import record

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from plants import PROGRAM, two_link_profile

DURATION = 20.0  # s of each recording
DEGC = (20.0, 60.0)
Spoil = Callable[[Recording, int], Recording]


def scaled(factor: float, one: bool = False) -> Spoil:
    """Torque times a factor, of all joints or of one."""

    def spoil(recording: Recording, joint: int) -> Recording:
        torque = recording.torque.motor_torque_measured.copy()
        torque[:, joint if one else slice(None)] *= factor
        return replace(recording, torque=replace(recording.torque, motor_torque_measured=torque))

    return spoil


def driving_friction(recording: Recording, joint: int) -> Recording:
    """Friction of one joint turned: it drives instead of braking."""
    torque = recording.torque.motor_torque_measured.copy()
    friction = recording.power.motor_torque - recording.torque.motor_torque_rigid
    torque[:, joint] -= 2.0 * friction[:, joint]
    return replace(recording, torque=replace(recording.torque, motor_torque_measured=torque))


def gear_turned(model: RobotModel, joint: int) -> RobotModel:
    """The model with one gear ratio of the wrong sign."""
    joints = list(model.joints)
    ratio = joints[joint].gear_ratio
    turned = ratio.model_copy(update={"value": -ratio.value})
    joints[joint] = joints[joint].model_copy(update={"gear_ratio": turned})
    return model.model_copy(update={"joints": joints}).with_urdf(model.urdf_xml, model.source)


CASES: dict[str, tuple[Spoil, bool]] = {  # and whether a gate should refuse
    "as recorded": (scaled(1.0), False),
    "torque of all joints turned": (scaled(-1.0), True),
    "torque of one joint turned": (scaled(-1.0, one=True), True),
    "gear sign of one joint wrong": (scaled(1.0), True),
    "torque times root 2": (scaled(2.0**0.5), False),
    "torque times 5": (scaled(5.0), True),
    "friction of one joint drives": (driving_friction, True),
}


def refusal(recordings: list[Recording]) -> str:
    """Which gate refuses, or why nothing can be identified; empty if all pass."""
    try:
        check_signs(recordings, EffortMeaning.MOTOR_TORQUE)
        result = identify_dynamics(
            channels_of([part.motion for part in recordings]), recordings[0].model
        )
        check_dynamics(result, result.held_out_consistent())
        axes = [friction_data(recordings, k) for k in range(len(recordings[0].model.joints))]
        check_friction(fit_axes(axes)[0])
    except ImplausibleIdentificationError as error:
        return error.found
    except NotIdentifiableError as error:
        return f"not identifiable: {error.found}"
    return ""


def plants(folder: Path, seed: int) -> Iterator[tuple[str, RobotModel, list[Path]]]:
    """Record every plant with one seed."""
    small = folder / f"small_{seed}"
    small.mkdir()
    profiles = {"two_link": two_link_profile(small), "kr16": load_profile("kr16")}
    for name, profile in profiles.items():
        program = PROGRAM
        if name == "kr16":
            robot, _ = profile.mechanics()
            program = random_program(profile.motion_limits(robot), seed, dwell=0.2)
        bags: list[Path] = []
        for degc in DEGC:
            bag = folder / f"{name}_{seed}_{degc:g}"
            record(VirtualRig(profile, program, RigConfig(), seed, degc), DURATION, bag)
            bags.append(bag)
        yield name, load(str(small / "two_link.yaml") if name == "two_link" else name), bags


def main() -> int:
    """Print the table; exit code 1 if a gate was wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    seeds = parser.parse_args().seeds
    right: dict[tuple[str, str], int] = {}
    said: dict[str, str] = {}
    effort = EffortMeaning.MOTOR_TORQUE
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(seeds):
            for plant, model, bags in plants(Path(folder), seed):
                joint = seed % len(model.joints)
                for case, (spoil, refused) in CASES.items():
                    used = gear_turned(model, joint) if "gear" in case else model
                    read = [spoil(read_recording(bag, used, effort), joint) for bag in bags]
                    why = refusal(read)
                    key = (case, plant)
                    right[key] = right.get(key, 0) + (bool(why) == refused)
                    said[case] = why or said.get(case, "")
    names = ("two_link", "kr16")
    page = Console(width=200)
    table(
        page,
        f"How often the gates were right, {seeds} seeds",
        ("case", "should", *names, "reason, for example"),
        [
            (
                case,
                "refuse" if refused else "pass",
                *(f"{right[case, name]} of {seeds}" for name in names),
                said[case],
            )
            for case, (_, refused) in CASES.items()
        ],
    )
    return int(any(count != seeds for count in right.values()))


if __name__ == "__main__":
    raise SystemExit(main())
