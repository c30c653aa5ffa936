"""How often `robot-energy check` names a deliberate mistake, and how often it blames a sound bag.

python test/bench/check_mistakes.py --model kr16 bags/kr16_cold bags/kr16_warm

Mistakes of the meter are left out where a recording has none, and the payload is changed by a
fifth where the model has one, else by 5 % of the moving mass.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent.parent))

from mistakes import METER, mistakes, rewrite
from robot_energy.bag import BagReader
from robot_energy.blocks import EffortMeaning
from robot_energy.check import check
from robot_energy.model import RobotModel, load, validate
from robot_energy.physics.rigid_body import Robot

EFFORT = EffortMeaning.MOTOR_TORQUE


def changed(model: RobotModel, change: Callable[[dict[str, Any]], None]) -> RobotModel:
    """Return a model with one change of its plain values."""
    data = model.model_dump(exclude_none=True, mode="json")
    data["urdf"] = {"xml": model.urdf_xml}
    change(data)
    return validate(data, "changed")


def of_the_model(model: RobotModel, joint: int) -> dict[str, tuple[str, RobotModel]]:
    """Models with a mistake: the cause to be named, and the model."""

    def gear(data: dict[str, Any]) -> None:
        data["joints"][joint]["gear_ratio"]["value"] *= 0.5

    def payload(data: dict[str, Any]) -> None:
        if data["payload"]:
            data["payload"][0]["mass"] /= 1.2
            return
        link = data["urdf"]["xml"].split("<link")[-1].split('"')[1]
        mass = 0.05 * Robot.from_model(model).moving_mass
        data["payload"] = [{"link": link, "mass": mass, "tag": "assumed"}]

    return {
        "gear ratio halved": ("gear_ratio", changed(model, gear)),
        "payload": ("payload", changed(model, payload)),
    }


def main() -> int:
    """Print one line per mistake and the shares."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bags", nargs="+", type=Path)
    parser.add_argument("--model", default="kr16")
    parser.add_argument("--joints", default="1,2,4", help="joints that get the mistakes, from 0")
    args = parser.parse_args()
    model = load(args.model)
    count = len(model.joints)
    named = silent = tried = false = 0

    def tell(what: str, cause: str, bag: Path, used: RobotModel) -> None:
        nonlocal named, silent, tried
        causes = list(dict.fromkeys(entry.cause for entry in check(bag, used, EFFORT).errors))
        right = causes == [cause]
        tried, named, silent = tried + 1, named + right, silent + (not causes)
        print(f"  {what}: {', '.join(causes) or 'silent'}{'' if right else '  WRONG'}", flush=True)

    for bag in args.bags:
        alarms = [e.cause for e in check(bag, model, EFFORT).findings if e.severity != "note"]
        false += bool(alarms)
        print(f"{bag.name}: unspoiled: {alarms or 'nothing found'}")
        has_meter = any(info.msgtype == METER for info in BagReader(bag).topics.values())
        for joint in map(int, args.joints.split(",")):
            name = model.joint_names[joint]
            for what, (cause, used) in of_the_model(model, joint).items():
                tell(f"{name} {what}", cause, bag, used)
            for what, (cause, states, meter) in mistakes(joint, joint + 1, count).items():
                if meter is not None and not has_meter:
                    continue
                with tempfile.TemporaryDirectory() as folder:
                    spoiled = rewrite(bag, Path(folder) / "bag", states, meter)
                    tell(f"{name} {what}", cause, spoiled, model)
    bags = len(args.bags)
    print(f"named {named} of {tried}, silent {silent}, false alarms {false} of {bags}")
    return 0 if named == tried and not false else 1


if __name__ == "__main__":
    sys.exit(main())
