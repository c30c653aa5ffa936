"""A fleet of virtual robots with three faults, as bags: the example of the fleet report.

Twenty robots of one type work two shifts on five days of each week, and two programmes, which
change every day. Each shift is recorded for a minute or two. Robots differ as those of one
delivery do: friction of every axis by a few percent, torque constants, sensors and meters within
their classes. Halls, and how warm a robot has run, change from day to day. Of the robots one has
an axis that wears from the third week on, one carries another payload than its model file says,
and one stands with its drives on all night. Everything is simulated, with all effects of the rig.

Run it with ``python -m robot_energy_studies.generated_fleet FOLDER``.
"""

from __future__ import annotations

import csv
import time
from argparse import ArgumentParser
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.units import SECOND_NS
from robot_energy.model import load
from robot_energy.model.payload import payload
from robot_energy_plan.motion import MotionLimits, Program, random_program
from robot_energy_rig import PlantProfile, RigConfig, VirtualRig, load_profile
from robot_energy_rig.record import record

ROBOT = "kr16"
BEGIN = datetime(2026, 3, 2, tzinfo=UTC)  # a Monday
SHIFTS = (7, 16)  # hour at which the bag of each shift begins
NIGHT = 23  # hour at which the bag of a night begins
WORKDAYS = 5  # of a week
PROGRAMMES = ("palletising", "assembly")
MOVES = 6  # of a cycle
CYCLES = 6  # in a bag
RATE, NIGHT_RATE = 50.0, 2.0  # of the joint states [Hz]
NIGHT_TIME = 1800.0  # recorded of a night [s]
OVERRIDE = 0.8  # share of full speed [-]
REST = 0.3  # at every pose [s]
MAX_PAUSE = 100.0  # behind the cycles [s]
FRICTION_SPREAD = 0.05  # of the friction of an axis over the robots, standard deviation [-]
TORQUE_SPREAD = 0.01  # of their torque constants [-]
HALL_DEGC = (17.0, 27.0)
WARM = (3.0, 25.0)  # motors above the hall when a bag begins [K]

WORN, WORN_AXIS, WEAR_FROM, WEAR = 6, 2, 0.5, 0.4  # robot, axis, from which share on, at the end
MISLOADED, MISSING = 11, 5.0  # robot, and what it carries less than its model file says [kg]
AWAKE = 16  # robot that stands by all night
MAX_SEED = 2_147_483_647


@dataclass(frozen=True)
class FleetPlan:
    """What is made."""

    robots: int = 20
    weeks: int = 5
    seed: int = 0
    faults: bool = True

    def faulty(self) -> dict[str, str]:
        """Return the kind of fault by robot."""
        kinds = {WORN: "friction", MISLOADED: "payload", AWAKE: "standby"}
        if not self.faults:
            return {}
        return {_name_of(robot % self.robots): kind for robot, kind in kinds.items()}


class Visit(Described):
    """A time at one robot that is recorded."""

    robot: str
    name: str
    rig: VirtualRig
    duration: Annotated[float, "Of the recording. [s]"]
    programme: Annotated[str, "What the robot does; empty for a night."]
    start: Annotated[int, "Stamp of the first sample. [s since 1970]"]
    cycle: Annotated[float, "Length of a cycle; 0 for a night. [s]"]

    @property
    def jobs(self) -> list[tuple[float, float]]:
        """Begin and end of every cycle. [s since 1970]"""
        count = CYCLES if self.cycle else 0
        return [(self.start + k * self.cycle, self.start + (k + 1) * self.cycle)
                for k in range(count)]  # fmt: skip


def _name_of(robot: int) -> str:
    return f"robot-{robot + 1:02d}"


def visits(plan: FleetPlan) -> Iterator[Visit]:
    """Yield the robots, one after the other, at the times at which each is recorded."""
    profile = load_profile(ROBOT)
    limits = profile.motion_limits(profile.mechanics()[0])
    programmes = [
        random_program(limits, 1000 * plan.seed + place, MOVES, 0.6).via
        for place in range(len(PROGRAMMES))
    ]
    for robot in range(plan.robots):
        yield from _visits(plan, profile, limits, programmes, robot)


def _visits(
    plan: FleetPlan,
    profile: PlantProfile,
    limits: MotionLimits,
    programmes: list[np.ndarray],
    robot: int,
) -> Iterator[Visit]:
    own = np.random.default_rng([plan.seed, robot])
    spread = np.exp(FRICTION_SPREAD * own.standard_normal((3, profile.n_joints)))
    plant = replace(
        profile,
        coulomb=profile.coulomb * spread[0],
        load_coulomb=profile.load_coulomb * spread[0],
        stribeck=profile.stribeck * spread[1],
        viscous_40=profile.viscous_40 * spread[2],
    )
    hard = RigConfig.hard()
    config = replace(hard, sensors=replace(hard.sensors, torque_constant_error=TORQUE_SPREAD))
    dark = replace(config, sensors=replace(config.sensors, meter_rate=1.0, temperature_rate=0.02))
    name, device = _name_of(robot), 1000 * plan.seed + robot
    kind = plan.faulty().get(name, "")
    carried = load(profile.body).payload[0]
    for day in range(7 * plan.weeks):
        if day % 7 >= WORKDAYS:
            continue
        weather = np.random.default_rng([plan.seed, 10_000 + day]).uniform(*HALL_DEGC)
        for shift, hour in enumerate(SHIFTS):
            place = (day + shift) % len(PROGRAMMES)
            begin = BEGIN + timedelta(days=day, hours=hour, seconds=int(own.uniform(0, 18_000)))
            rest = np.full(CYCLES * MOVES, REST)
            pause = own.uniform(0.0, MAX_PAUSE)
            rest[-1] += pause
            program = Program(np.tile(programmes[place], (CYCLES, 1)), limits, rest, OVERRIDE)
            start = round(begin.timestamp())
            rig = VirtualRig(
                plant, program, config, int(own.integers(MAX_SEED)), weather + own.uniform(*WARM),
                weather, start * SECOND_NS, RATE, device_seed=device,
            )  # fmt: skip
            if kind == "payload":
                less = carried.mass - MISSING
                rig.change(payload=[payload(carried.link, less, carried.centre_of_mass)])
            if kind == "friction":
                worn, share = np.ones(profile.n_joints), day / (7 * plan.weeks - 1)
                worn[WORN_AXIS] += WEAR * max(share - WEAR_FROM, 0.0) / (1.0 - WEAR_FROM)
                rig.change(wear=worn)
            yield Visit(
                name, f"{begin:%F}-shift{shift + 1}", rig, program.period, PROGRAMMES[place], start,
                (program.period - pause) / CYCLES,
            )  # fmt: skip
        if kind == "standby":
            begin = BEGIN + timedelta(days=day, hours=NIGHT)
            start = round(begin.timestamp())
            still = Program(programmes[0][:1], limits, 1.0)
            rig = VirtualRig(
                plant, still, dark, int(own.integers(MAX_SEED)), weather + 10.0, weather,
                start * SECOND_NS, NIGHT_RATE, device_seed=device,
            )  # fmt: skip
            yield Visit(name, f"{begin:%F}-night", rig, NIGHT_TIME, "", start, 0.0)


def _write_bags(folder: Path, plan: FleetPlan) -> int:
    """Record the fleet: a folder for each robot, and ``bags.csv``, the table of all its bags."""
    folder.mkdir(parents=True, exist_ok=True)
    count = 0
    with (folder / "bags.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["bag", "model", "robot", "programme", "jobs", "effort"])
        for visit in visits(plan):
            bag, jobs = Path(visit.robot) / visit.name, ""
            record(visit.rig, visit.duration, folder / bag)
            if visit.jobs:
                lines = [
                    f"  - {{name: {visit.programme}, begin: {begin:.3f}, end: {end:.3f}}}\n"
                    for begin, end in visit.jobs
                ]
                jobs = f"{bag}-jobs.yaml"
                (folder / jobs).write_text("jobs:\n" + "".join(lines))
            rows.writerow([bag, ROBOT, visit.robot, visit.programme, jobs, "motor_torque"])
            count += 1
    return count


def main(argv: list[str] | None = None) -> int:
    """Return the exit code, after the fleet and a table of its bags are made.

    Args:
        argv: Words of the command line; None for those of the process.
    """
    parser = ArgumentParser(prog="generated_fleet", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path, help="where the bags go; bags.csv lists them")
    parser.add_argument("--robots", type=int, default=20, metavar="N", help="default 20")
    parser.add_argument("--weeks", type=int, default=5, metavar="N", help="default 5")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="default 0")
    parser.add_argument("--sound", action="store_true", help="without the three faults")
    args = parser.parse_args(argv)
    plan = FleetPlan(args.robots, args.weeks, args.seed, not args.sound)
    begun = time.perf_counter()
    count = _write_bags(args.folder, plan)
    size = sum(path.stat().st_size for path in args.folder.rglob("*") if path.is_file())
    print(f"{count} bags, {size / 1e6:.0f} MB, {time.perf_counter() - begun:.0f} s")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
