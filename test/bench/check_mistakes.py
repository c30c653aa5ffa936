"""How often `robot-energy check` names a deliberate mistake, and how often it blames a sound bag.

python test/bench/check_mistakes.py kr16_cold kr300_A kr16:0 ur5e:100

A name is that of a recording of the project, of the folder ``ROBOT_ENERGY_DATA``, or ROBOT:SEED:
the virtual rig with a plant drawn at random, or ROBOT:SEED:PROGRAM: a foreign robot, of which there
is no more than a URDF whose bodies are off; ``foreign:SEED`` is forty of these. For every mistake
the joint is drawn as well. A mistake counts as named if its cause and its joint are the first
finding and no other cause is blamed; as named with others if the check says that it is one of
several that cannot be distinguished; as not to be judged if the check says so of that quantity and
that joint; else as named wrongly or as silent. Where one is named, its remedy is applied, and the
recording is checked again. Mistakes of a signal that a recording lacks are left out by name.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))

from mistakes import METER, Mistake, mistakes, rewrite
from robot_energy.bag import BagReader
from robot_energy.model import RobotModel, validate
from robot_energy_identify.check import CheckResult, Finding, check
from sound_recordings import PROGRAMS, Sound, plain, sound, with_remedy

NAMED, EITHER, WRONG, SILENT, UNJUDGED, MISSING = (
    "named", "named with others", "named wrongly", "silent", "cannot be judged", "not applicable"
)  # fmt: skip
GONE, LEFT = "remedy mends", "remedy does not mend"
ROBOTS = ("kr16", "irb4600", "mantis", "ur3e", "ur5e", "ur10e", "arm4", "arm5", "arm6", "arm7")

CHECK_OF = dict.fromkeys(
    ("torque_sign", "joint_sign", "zero_offset", "torque_scale", "joint_order", "gear_ratio",
     "payload"), "torque",
) | {"degrees": "positions and velocities"} | dict.fromkeys(
    ("meter_sign", "meter_unit", "meter_clock"), "power meter"
)  # fmt: skip


def changed(model: RobotModel, change: Callable[[dict[str, Any]], None]) -> RobotModel:
    """Return a model with one change of its plain values."""
    data = plain(model)
    change(data)
    return validate(data, "changed")


def of_the_model(one: Sound, joint: int) -> dict[str, tuple[str, RobotModel]]:
    """Models with a mistake: the cause to be named, and the model."""
    model, mass = one.model, max(2.0, 0.2 * one.rated)

    def gear(data: dict[str, Any]) -> None:
        data["joints"][joint]["gear_ratio"]["value"] *= 0.5

    def payload(data: dict[str, Any]) -> None:
        carried = data.get("payload") or []
        if carried and carried[0]["mass"] > mass:
            carried[0]["mass"] -= mass
            return
        link = data["urdf"]["xml"].split("<link")[-1].split('"')[1]
        if model.payload:
            link = model.payload[0].link
        data["payload"] = [*carried, {"link": link, "mass": mass, "tag": "assumed"}]

    return {
        "gear ratio halved": ("gear_ratio", changed(model, gear)),
        f"payload {mass:.1f} kg off": ("payload", changed(model, payload)),
    }


def outcome(result: CheckResult, cause: str, joints: tuple[str, ...], size: float) -> str:
    """What the check made of a mistake of a size."""

    def about(entry: Finding) -> bool:
        return cause in (entry.cause, *entry.alternatives) and set(joints) <= {*entry.subject}

    found = result.errors
    if found:
        alone = all(entry.cause == found[0].cause for entry in found)
        same = not joints or {*joints} == {*found[0].subject}
        return NAMED if alone and same and found[0].cause == cause else WRONG
    open_ones = [one for one in result.findings if one.severity == "warning" and doubted(one)]
    if open_ones:
        return EITHER if any(map(about, open_ones)) else WRONG
    if any(CHECK_OF[cause] == name for name in result.skipped):
        return UNJUDGED
    for entry in result.findings:
        about_it = entry.cause in (f"unjudged.{cause}", "unjudged.torque")
        if about_it and (not joints or set(joints) & set(entry.subject)):
            return UNJUDGED if cause != "payload" or size < entry.evidence else SILENT
    return SILENT


def doubted(entry: Finding) -> bool:
    """Whether a finding doubts the torque, and names what may be wrong."""
    return CHECK_OF.get(entry.cause) == "torque"


def trials(
    one: Sound, seed: int, folder: Path
) -> list[tuple[str, str, tuple[str, ...], Callable[[], Path], RobotModel]]:
    """Mistakes of a recording: what, the cause, its joints, how the bag is made, the model."""
    rng = np.random.default_rng(seed)
    names, n = one.model.joint_names, len(one.model.joints)
    found: list[tuple[str, str, tuple[str, ...], Callable[[], Path], RobotModel]] = []
    pick = lambda: int(rng.integers(n))  # noqa: E731
    joint = pick()
    for what, (cause, used) in of_the_model(one, joint).items():
        subject = (names[joint],) if cause == "gear_ratio" else ()
        found.append((what, cause, subject, lambda: one.bag, used))
    other = (pick(), pick())
    joint, second = other[0], (other[0] + 1 + other[1] % max(n - 1, 1)) % n
    for what, mistake in mistakes(joint, second, n).items():
        at = len(found)

        def make(mistake: Mistake = mistake, at: int = at) -> Path:
            return rewrite(one.bag, folder / f"spoiled_{at}", mistake.states, mistake.meter)

        subject = tuple(names[j] for j in mistake.joints)
        found.append((what, mistake.cause, subject, make, one.model))
    return found


def lacks(one: Sound, what: str, cause: str) -> str:
    """Why a recording cannot carry a mistake; empty if it can."""
    bag = BagReader(one.bag)
    n = len(one.model.joints)
    if what.startswith("meter") and not any(t.msgtype == METER for t in bag.topics.values()):
        return "no meter"
    if "exchanged" in what and n < 2:
        return "one joint"
    if n == 1 and what == "sign of all torques":
        return "one joint"
    if one.model.robot.type.lower().startswith("testbed"):
        if what in ("degrees", "zero offset 0.1 rad"):
            return "no revolute joint"
    if not one.bodies and CHECK_OF[cause] == "torque":
        return "no model of this robot's bodies"
    return ""


def expanded(names: list[str]) -> list[str]:
    """Names of recordings, with those of ``foreign:SEED``."""
    found: list[str] = []
    for name in names:
        if not name.startswith("foreign:"):
            found.append(name)
            continue
        pairs = [(robot, program) for robot in ROBOTS for program in list(PROGRAMS)[1:]]
        first = int(name.split(":")[1])
        found += [f"{robot}:{first + k}:{program}" for k, (robot, program) in enumerate(pairs)]
    return found


def said(entries: Iterable[Finding]) -> str:
    """Findings in short."""
    return "; ".join(
        f"{e.severity[0]}:{e.cause} {','.join(e.subject)} {e.evidence:.3g}"
        + "".join(f" or {other}" for other in e.alternatives)
        for e in entries
    )


def main() -> int:
    """Print one line per mistake and the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recordings", nargs="+")
    parser.add_argument("--seed", type=int, default=1, help="of the joints that are drawn")
    parser.add_argument("--sound", action="store_true", help="no mistakes: only the sound ones")
    parser.add_argument("--verbose", action="store_true")
    args = parser.parse_args()
    folder = os.environ.get("ROBOT_ENERGY_DATA")
    total: Counter[str] = Counter()
    alarms = doubts = 0
    names = expanded(args.recordings)
    for place, name in enumerate(names):
        with tempfile.TemporaryDirectory() as made:
            one = sound(name, Path(folder) if folder else None, Path(made))
            result = check(one.bag, one.model, one.effort)
            loud = [e for e in result.findings if e.severity != "note"]
            alarms += bool(result.errors)
            doubts += any(map(doubted, loud)) and not result.errors
            count: Counter[str] = Counter()
            lines: list[str] = []
            tried = [] if args.sound else trials(one, args.seed + place, Path(made))
            for what, cause, joints, make, model in tried:
                why = lacks(one, what, cause)
                if why:
                    count[MISSING] += 1
                    lines.append(f"  {what}: not applicable ({why})")
                    continue
                bag = make()
                result = check(bag, model, one.effort)
                size = float(what.split()[1]) if cause == "payload" else 0.0
                verdict = outcome(result, cause, joints, size)
                count[verdict] += 1
                if verdict == NAMED:
                    mended, inputs = with_remedy(result.errors[0], model, Path(made))
                    left = check(bag, mended, one.effort, inputs).errors
                    count[LEFT if left else GONE] += 1
                    if left:
                        lines.append(f"  {what}: after the remedy [{said(left)}]")
                if verdict != NAMED or args.verbose:
                    blamed = said(e for e in result.findings if e.severity != "note")
                    lines.append(f"  {what} of {', '.join(joints) or 'all'}: {verdict} [{blamed}]")
            total += count
            print(f"{one.name}: {dict(count)}; unspoiled: {said(loud) or 'nothing'}", flush=True)
            print("\n".join(lines), flush=True)
    print(f"{dict(total)}; of {len(names)} sound ones {alarms} blamed, {doubts} doubted")
    return 0 if not total[SILENT] + total[WRONG] + alarms else 1


if __name__ == "__main__":
    sys.exit(main())
