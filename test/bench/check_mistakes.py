"""How often `robot-energy check` names a deliberate mistake, and how often it blames a sound bag.

python test/bench/check_mistakes.py BAG...    (recordings of the virtual rig's KR 16)
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent))

from mistakes import mistakes, rewrite
from robot_energy.blocks import EffortMeaning
from robot_energy.check import check
from robot_energy.model import load

JOINTS = ((1, 2), (2, 4), (4, 3))  # the joint with the mistake, and the one exchanged with it


def main(bags: list[str]) -> int:
    """Print one line per mistake and the shares."""
    model = load("kr16")
    named = silent = tried = false = 0
    for bag in bags:
        sound = check(bag, model, EffortMeaning.MOTOR_TORQUE)
        alarms = [entry.cause for entry in sound.findings if entry.severity != "note"]
        false += bool(alarms)
        print(f"{Path(bag).name}: unspoiled: {alarms or 'nothing found'}")
        for joint, other in JOINTS:
            for name, (cause, states, meter) in mistakes(joint, other, 6).items():
                with tempfile.TemporaryDirectory() as folder:
                    spoiled = rewrite(Path(bag), Path(folder) / "bag", states, meter)
                    found = check(spoiled, model, EffortMeaning.MOTOR_TORQUE).errors
                causes = [entry.cause for entry in found]
                right = causes[:1] == [cause]
                tried, named, silent = tried + 1, named + right, silent + (not causes)
                print(f"  {model.joint_names[joint]} {name}: {', '.join(causes) or 'silent'}"
                      f"{'' if right else '  WRONG'}", flush=True)  # fmt: skip
    print(
        f"named correctly {named} of {tried}, silent {silent}, false alarms {false} of {len(bags)}"
    )
    return 0 if named == tried and not false else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
