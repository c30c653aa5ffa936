"""A robot whose registers are counted in whole numbers, as readings for the history."""

from __future__ import annotations

import random
from dataclasses import dataclass, field

from robot_energy_history.readings import COLUMNS, JOINT_COLUMNS, Reading

SECOND = 10**9
MINUTE = 60 * SECOND
HOUR = 60 * MINUTE
DAY = 24 * HOUR
JOINTS = ("shoulder", "elbow")
START = 1_767_225_600 * SECOND  # 2026-01-01, UTC


@dataclass
class Robot:
    """Counts time and energy exactly; `advance` to a time, `read` what its registers are.

    Attributes:
        now: Stamp of its newest sample. [ns]
    """

    seed: int = 0
    now: int = START
    model: str = "m1"
    meter: int = 1
    start: int = START
    values: dict[str, int] = field(default_factory=lambda: dict.fromkeys(COLUMNS, 0))
    joints: dict[str, list[int]] = field(
        default_factory=lambda: {name: [0] * len(JOINT_COLUMNS) for name in JOINTS}
    )

    def __post_init__(self):
        self.random = random.Random(self.seed)

    def advance(self, ns: int, watt: int | None = None, standby: bool = False) -> None:
        """Work for a time, or stand by, at a power drawn from the grid, else a random one."""
        self.now += ns
        power = self.random.randint(100, 4000) if watt is None else watt
        energy = power * ns // 1000  # uJ
        self.values["observed_ns"] += ns
        self.values["predicted_import_microjoule"] += energy
        for kind in ("hold", "standby") if standby else ("motion",):
            self.values[f"{kind}_microjoule"] += energy
            self.values[f"{kind}_ns"] += ns
        self.values["measured_microjoule"] += energy + self.random.randint(-9, 9)
        self.values["compared_ns"] += ns
        self.values["capacitor_microjoule"] += self.random.randint(-5, 5)
        for own in self.joints.values():
            for place in range(len(own)):
                own[place] += self.random.randint(0, energy // 20 + 1)
        for place, name in ((2, "rigid"), (3, "friction"), (4, "drive_loss")):
            self.values[f"{name}_microjoule"] = sum(own[place] for own in self.joints.values())

    def rest(self, ns: int) -> None:
        """Let no joint states come."""
        self.now += ns
        self.values["gap_ns"] += ns

    def step_clock(self, ns: int) -> None:
        """Set its clock; no time passes."""
        self.now += ns

    def reset(self) -> None:
        """Set the registers to zero."""
        self.values = dict.fromkeys(COLUMNS, 0)
        self.joints = {name: [0] * len(JOINT_COLUMNS) for name in JOINTS}
        self.start = self.now

    def read(self, minute: int = 0) -> Reading:
        """The registers as they are.

        Args:
            minute: UTC minute at which they are read; 0 for none. [ns]
        """
        return Reading(
            self.start,
            self.now,
            minute,
            self.model,
            self.meter,
            tuple(self.values.values()),
            {name: tuple(own) for name, own in self.joints.items()},
        )

    def minute(self, watt: int | None = None) -> Reading:
        """Work up to the next minute, and read there."""
        end = (self.now // MINUTE + 1) * MINUTE
        self.advance(end - self.now, watt)
        return self.read(end)


@dataclass
class Course:
    """What happens to a robot and its recorder over days, and how often.

    Attributes:
        days: Length. [days]
        kills: Of the recorder, at any place; it starts again, or a second one takes over.
        resets: Of the registers.
        steps: Of the clock, forth and back.
        changes: Of the model or the place of the meter.
        lates: Batches of readings that come again, or late.
        off_days: How long the recorder is off, once. [days]
        period: Between two readings. [ns]
    """

    days: int
    kills: int
    resets: int
    steps: int
    changes: int
    lates: int
    off_days: float = 0.0
    period: int = MINUTE


def run_course(folder, course: Course, seed: int, start: int = START) -> tuple[int, Robot]:
    """Record a course; return the energy of all registers that were set to zero, and the robot."""
    from robot_energy_history.store import HistoryStore

    draw, robot = random.Random(seed), Robot(seed, now=start, start=start)
    count = course.days * DAY // course.period
    kinds = ("kills", "resets", "steps", "changes", "lates")
    planned: dict[int, list[str]] = {}
    for kind in kinds:
        for place in draw.sample(range(count), getattr(course, kind)):
            planned.setdefault(place, []).append(kind)
    off = range(count // 2, count // 2 + int(course.off_days * DAY / course.period))
    store, second, done, lately = HistoryStore(folder), HistoryStore(folder), 0, []
    store.open()
    for place in range(count):
        end = (robot.now // course.period + 1) * course.period
        readings = []
        for kind in planned.get(place, ()):
            robot.advance(draw.randint(1, course.period // 3))
            if robot.now >= end:
                end += course.period
            match kind:
                case "kills":
                    store.add("a", readings)
                    assert not second.write(robot.now)  # as long as the first holds the lock
                    assert "another process" in second.trouble
                    store.close()  # what it had not written is gone
                    takes_over, readings = draw.random() < 0.5, []
                    store = second if takes_over else HistoryStore(folder)
                    second = HistoryStore(folder) if takes_over else second
                    store.open()
                case "resets":
                    readings.append(robot.read())
                    done += robot.values["predicted_import_microjoule"]
                    robot.reset()
                case "steps":
                    readings.append(robot.read())
                    robot.step_clock(draw.choice((-1, 1)) * draw.randint(1, 5 * HOUR))
                    end = (robot.now // course.period + 1) * course.period
                case "changes":
                    robot.model = f"m{draw.randint(1, 9)}"
                    robot.meter = draw.choice((1, 2))
                case _:
                    readings += lately[-draw.randint(1, 20) :]
        if draw.random() < 0.02:
            robot.rest(draw.randint(1, course.period // 4))
        if robot.now < end:
            robot.advance(end - robot.now)
        readings.append(robot.read(end if robot.now == end else 0))
        lately = [*lately[-20:], *readings[-1:]]
        if place in off and place != off[-1]:
            # A monitor that is reset while the recorder is off: that energy is in no message.
            readings = [one for one in readings if one.energy_start_ns != robot.start]
        store.add("a", readings)
        second.add("a", readings)
        if draw.random() < 0.3:
            assert store.write(robot.now), store.trouble
    store.add("a", [robot.read()])
    assert store.write(robot.now, newest=True), store.trouble
    store.close()
    return done, robot


def record_days(folder, robots, days=90, better_from=60):
    """Days of robots with parts of 1 kWh and 5 kWh besides, less by a share from a day on.

    Args:
        robots: Share that each saves, by name.

    Friction of its elbow grows by 2 % in ten days, over model m1, and over m2 from the middle on.
    """
    from robot_energy_history.database import JOB_COLUMNS
    from robot_energy_history.readings import LearnedFriction
    from robot_energy_history.store import HistoryStore

    store = HistoryStore(folder)
    store.open()
    for place, (name, saving) in enumerate(robots.items()):
        robot, draw = Robot(), random.Random(place)
        for day in range(days):
            parts = draw.randint(2, 20)
            kwh = 5.0 + parts + draw.gauss(0.0, 0.2)
            robot.advance(HOUR // 4, round(4000 * kwh * (1 - saving * (day >= better_from))))
            store.add(name, [robot.read(robot.now)])
            robot.step_clock(DAY - HOUR // 4)
            stop = START + day * DAY + HOUR
            job = dict.fromkeys(JOB_COLUMNS, 0) | {"name": "weld", "start": stop - HOUR}
            job |= {"stop": stop, "observed_ns": MINUTE}
            store.add_jobs(
                name,
                [
                    job | {"id": number, "predicted_import_microjoule": round(3.6e12 * kwh / parts)}
                    for number in range(parts)
                ],
            )
            ratios = {"elbow": 1.0 + 0.002 * day, "wrist": 1.0}
            model = "m1" if day < days // 2 else "m2"
            store.add_friction(name, [LearnedFriction(stop, model, ratios)])
        assert store.write(robot.now), store.trouble
    for _ in range(days // 7):
        assert store.write(START + (days + 1) * DAY), store.trouble
    store.close()
