"""What a fleet of robots has done with its energy, and which robots need somebody to look."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from robot_energy.identify.friction.friction import FrictionFit
from robot_energy.results.base import Number, Result


@dataclass(frozen=True)
class RefusedBag(Result):
    """A bag that could not be read.

    Attributes:
        bag: Its place.
        robot: Name of the robot.
        reason: Why not.
    """

    bag: str
    robot: str
    reason: str


@dataclass(frozen=True)
class DamagedBag(Result):
    """A bag that is damaged: what could be read of it counts.

    Attributes:
        bag: Its place.
        robot: Name of the robot.
        problems: What is wrong with it, one sentence each.
    """

    bag: str
    robot: str
    problems: tuple[str, ...]


@dataclass(frozen=True)
class FleetRunReport(Result):
    """What a run over the bags of a fleet has done.

    Attributes:
        dataset: Where the rows are.
        bags: That were asked for, how many.
        there: Of them, that the dataset held already, unchanged.
        replayed: How many.
        refused: Bags that could not be used.
        damaged: Bags replayed that were read in part.
        jobs_left_out: Jobs of which a bag replayed holds a part only, how many.
        observed_time: Predicted, of the bags replayed. [s]
        elapsed_time: That the run took. [s]
        row_size: Of the rows written. [bytes]
        peak_memory: Most memory that one worker has held. [bytes]
    """

    NAME: ClassVar[str] = "fleet_run"

    dataset: str
    bags: int
    there: int
    replayed: int
    refused: tuple[RefusedBag, ...]
    damaged: tuple[DamagedBag, ...]
    jobs_left_out: int
    observed_time: float
    elapsed_time: float
    row_size: int
    peak_memory: int


@dataclass(frozen=True)
class RobotEnergy(Result):
    """Energy of one robot, in what was recorded of it.

    Attributes:
        robot: Its name.
        bags: How many were read.
        observed_time: Predicted. [s]
        grid_energy: From the grid, predicted. [J]
        measured_energy: By the meter, over the compared time; None without one. [J]
        error: Predicted over measured energy less 1, over the compared time. [-]
        jobs: How many.
        standby_time: At rest with drives on, a minute or more at a time. [s]
        standby_energy: From the grid meanwhile. [J]
        standby_cost: At the price of each hour; None without prices. [currency]
    """

    robot: str
    bags: int
    observed_time: float
    grid_energy: float
    measured_energy: Number
    error: Number
    jobs: int
    standby_time: float
    standby_energy: float
    standby_cost: Number


@dataclass(frozen=True)
class ProgrammeEnergy(Result):
    """Energy of all jobs of one name.

    Attributes:
        name: Of the programme.
        robots: That have done it.
        jobs: Whole ones, how many.
        mean_time: Of a job. [s]
        mean_energy: Of a job, from the grid, predicted. [J]
        lowest: The mean of the robot that needs least. [J]
        highest: The mean of the robot that needs most. [J]
        error: Predicted over measured energy less 1, over the compared time. [-]
    """

    name: str
    robots: int
    jobs: int
    mean_time: float
    mean_energy: float
    lowest: float
    highest: float
    error: Number


@dataclass(frozen=True)
class ShiftEnergy(Result):
    """Energy of all robots in one shift of the day.

    Attributes:
        name: Its begin and end, local time.
        observed_time: Predicted. [s]
        grid_energy: From the grid. [J]
        cost: At the price of each hour; None without prices. [currency]
        standby_time: At rest with drives on. [s]
        standby_energy: From the grid meanwhile. [J]
        standby_cost: None without prices. [currency]
    """

    name: str
    observed_time: float
    grid_energy: float
    cost: Number
    standby_time: float
    standby_energy: float
    standby_cost: Number


@dataclass(frozen=True)
class ModelError(Result):
    """Error of the model in bags of like motor temperature.

    Attributes:
        low_degc: Mean motor temperature of the bags, from here. [degC]
        high_degc: To here. [degC]
        bags: With a meter, how many.
        error: Predicted over measured energy less 1, all together. [-]
        low: A tenth of the bags lie below. [-]
        high: A tenth of the bags lie above. [-]
    """

    low_degc: float
    high_degc: float
    bags: int
    error: float
    low: float
    high: float


@dataclass(frozen=True)
class FleetFinding(Result):
    """Something about one robot that somebody should look at.

    Attributes:
        robot: Its name.
        kind: ``wear``: friction of a joint has changed; ``friction``: it differs from that of the
            sisters; ``payload``: gravity says another payload; ``standby``: it stands with drives
            on; ``energy``: its jobs need more or less.
        subject: Joint or programme; empty for the whole robot.
        size: Change or difference: relative; of a payload [kg], of standby [h] a day.
        std: Its standard deviation, in the same unit.
        certainty: Probability that it is no chance, all comparisons considered. [-]
        since_ns: When a change began; None where nothing is known of it. [ns since 1970]
        sentence: The same in words.
    """

    robot: str
    kind: str
    subject: str
    size: float
    std: Number
    certainty: float
    since_ns: int | None
    sentence: str


@dataclass(frozen=True)
class FrictionCurve(Result):
    """Friction of one joint against the model: all robots, and each over temperature and time.

    Attributes:
        joint: Its name.
        degc: Motor temperatures. [degC]
        middle: Median of the robots at each; None where fewer than three were seen. [-]
        low: A tenth of the robots lie below. [-]
        high: A tenth of the robots lie above. [-]
        robots: Names of those whose curves follow: the ones with a finding on this joint.
        by_degc: Measured over model friction of each, at the same temperatures. [-]
        weeks_ns: Middle of each week. [ns since 1970]
        week_low: Over time at equal temperature: a tenth of the robots lie below. [-]
        week_middle: Median of the robots. [-]
        week_high: A tenth lie above. [-]
        by_week: Of the robots named, at equal temperature. [-]
    """

    joint: str
    degc: tuple[float, ...]
    middle: tuple[Number, ...]
    low: tuple[Number, ...]
    high: tuple[Number, ...]
    robots: tuple[str, ...]
    by_degc: tuple[tuple[Number, ...], ...]
    weeks_ns: tuple[int, ...]
    week_low: tuple[Number, ...]
    week_middle: tuple[Number, ...]
    week_high: tuple[Number, ...]
    by_week: tuple[tuple[Number, ...], ...]


@dataclass(frozen=True)
class FleetReport(Result):
    """Energy and condition of a fleet.

    Attributes:
        dataset: Where it lies.
        model_ids: Of the models used.
        start_ns: Of the first bag. [ns since 1970]
        end_ns: Of the last bag. [ns since 1970]
        bags: Read, how many.
        refused: Bags that could not be read.
        damaged: Bags that were read in part, and count with that.
        robots: By name.
        programmes: The most frequent first.
        shifts: In the order of the day.
        model_errors: From cold to warm.
        findings: Robots that need somebody, those of one robot together, the surest first.
        friction: Of each joint, in the order of the model.
        comparisons: Kinds of figures that robots were compared by.
        compared_with_sisters: Robots with enough sisters and bags for that, how many.
        compared_with_before: Robots with enough bags to be compared with themselves before, how
            many.
        not_compared: Where not all were: how many, and what it takes, one sentence each.
        notes: What a reader should know, one sentence each.
    """

    NAME: ClassVar[str] = "fleet_report"

    dataset: str
    model_ids: tuple[str, ...]
    start_ns: int | None
    end_ns: int | None
    bags: int
    refused: tuple[RefusedBag, ...]
    damaged: tuple[DamagedBag, ...]
    robots: tuple[RobotEnergy, ...]
    programmes: tuple[ProgrammeEnergy, ...]
    shifts: tuple[ShiftEnergy, ...]
    model_errors: tuple[ModelError, ...]
    findings: tuple[FleetFinding, ...]
    friction: tuple[FrictionCurve, ...]
    comparisons: int
    compared_with_sisters: int
    compared_with_before: int
    not_compared: tuple[str, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class FleetTorqueScore(Result):
    """Torque of bags that the fit has not seen, with the new friction and with that before.

    Attributes:
        joint: Its name.
        rms: Of the error of the friction torque. [N m]
        rms_before: With the friction of the model that the bags were run with. [N m]
        energy_error: Predicted over measured friction energy less 1. [-]
        energy_error_before: The same with that model. [-]
    """

    joint: str
    rms: float
    rms_before: float
    energy_error: Number
    energy_error_before: Number


@dataclass(frozen=True)
class FleetFriction(Result):
    """One friction model from all bags of a fleet.

    Attributes:
        dataset: Where it lies.
        bags: Used, how many.
        robots: Used, how many.
        axes: Friction of each joint.
        refused: Why other joints could not be identified, one sentence each.
        held_out: On a fifth of the bags at a time that the fit has not seen.
        left_out: Robots whose friction differs from that of their sisters.
    """

    NAME: ClassVar[str] = "fleet_friction"

    dataset: str
    bags: int
    robots: int
    axes: tuple[FrictionFit, ...]
    refused: tuple[str, ...]
    held_out: tuple[FleetTorqueScore, ...]
    left_out: tuple[str, ...]
