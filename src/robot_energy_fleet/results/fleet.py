"""What a fleet of robots has done with its energy, and which robots need somebody to look."""

from typing import Annotated

from robot_energy.results.base import Number, Result, Texts
from robot_energy_identify.friction.friction import FrictionFit


class RefusedBag(Result):
    """A bag that could not be read."""

    bag: Annotated[str, "Address of the bag."]
    robot: Annotated[str, "Name of the robot."]
    reason: Annotated[str, "Why it could not be read."]


class DamagedBag(Result):
    """A bag that is damaged, or whose joint states are doubtful: what was read of it counts."""

    bag: Annotated[str, "Address of the bag."]
    robot: Annotated[str, "Name of the robot."]
    problems: Annotated[Texts, "What is wrong with it, one sentence each."]


class FleetRunReport(Result, name="fleet_run"):
    """What a run over the bags of a fleet has done."""

    dataset: Annotated[str, "Folder of the dataset."]
    bags: Annotated[int, "Number of bags that were asked for."]
    there: Annotated[int, "Number of these that the dataset held already, unchanged."]
    replayed: Annotated[int, "Number of bags replayed."]
    refused: Annotated[tuple[RefusedBag, ...], "Bags that could not be used."]
    damaged: Annotated[tuple[DamagedBag, ...], "Bags replayed that are damaged or doubtful."]
    jobs_left_out: Annotated[int, "Number of jobs of which a replayed bag holds only a part."]
    observed_time: Annotated[float, "Predicted time of the bags replayed. [s]"]
    elapsed_time: Annotated[float, "Time that the run took. [s]"]
    row_size: Annotated[int, "Size of the rows written. [bytes]"]
    peak_memory: Annotated[int, "Most memory that one worker has held. [bytes]"]


class RobotEnergy(Result):
    """Energy of one robot, in what was recorded of it."""

    robot: Annotated[str, "Its name."]
    bags: Annotated[int, "Number of bags read."]
    observed_time: Annotated[float, "Predicted time. [s]"]
    grid_energy: Annotated[float, "From the grid, predicted. [J]"]
    measured_energy: Annotated[Number, "By the meter, over the compared time; None: no meter. [J]"]
    error: Annotated[Number, "Predicted over measured energy minus 1, over the compared time. [-]"]
    jobs: Annotated[int, "Number of jobs."]
    standby_time: Annotated[float, "At rest with drives on, a minute or more at a time. [s]"]
    standby_energy: Annotated[float, "Energy from the grid in that time. [J]"]
    standby_cost: Annotated[Number, "At the price of each hour; None without prices. [currency]"]


class ProgrammeEnergy(Result):
    """Energy of all jobs of one name."""

    name: Annotated[str, "Name of the programme."]
    robots: Annotated[int, "Number of robots that have done it."]
    jobs: Annotated[int, "Number of whole jobs."]
    mean_time: Annotated[float, "Mean time of a job. [s]"]
    mean_energy: Annotated[float, "Mean energy of a job from the grid, predicted. [J]"]
    lowest: Annotated[float, "The mean of the robot that needs least. [J]"]
    highest: Annotated[float, "The mean of the robot that needs most. [J]"]
    error: Annotated[Number, "Predicted over measured energy minus 1, over the compared time. [-]"]


class ShiftEnergy(Result):
    """Energy of all robots in one shift of the day."""

    name: Annotated[str, "Its beginning and end, local time."]
    observed_time: Annotated[float, "Predicted time. [s]"]
    grid_energy: Annotated[float, "Energy from the grid, predicted. [J]"]
    cost: Annotated[Number, "At the price of each hour; None without prices. [currency]"]
    standby_time: Annotated[float, "Time at rest with drives on, a minute or more at a time. [s]"]
    standby_energy: Annotated[float, "Energy from the grid in that time. [J]"]
    standby_cost: Annotated[Number, "None without prices. [currency]"]


class ModelError(Result):
    """Error of the model in bags of like motor temperature."""

    low_degc: Annotated[float, "Lower bound of the mean motor temperature of the bags. [degC]"]
    high_degc: Annotated[float, "Upper bound of it. [degC]"]
    bags: Annotated[int, "Number of bags with a meter."]
    error: Annotated[float, "Predicted over measured energy minus 1, all together. [-]"]
    low: Annotated[float, "A tenth of the bags lie below. [-]"]
    high: Annotated[float, "A tenth of the bags lie above. [-]"]


class FleetFinding(Result):
    """Something about one robot that somebody should look at."""

    robot: Annotated[str, "Its name."]
    kind: Annotated[
        str,
        "``wear``: friction of a joint has changed; ``friction``: it differs from that of the "
        "sisters; ``payload``: gravity shows another payload; ``standby``: it rests with drives "
        "on; ``energy``: its jobs need more or less.",
    ]
    subject: Annotated[str, "Joint or programme; empty for the whole robot."]
    size: Annotated[float, "Change or difference: relative; payload [kg], standby [h] a day."]
    std: Annotated[Number, "Its standard deviation, in the same unit."]
    certainty: Annotated[float, "Probability that it is not chance, of all comparisons. [-]"]
    since_ns: Annotated[int | None, "When a change began; None: not known. [ns since 1970]"]
    sentence: Annotated[str, "The same in words."]


class FrictionCurve(Result):
    """Friction of one joint against the model: all robots, and each over temperature and time."""

    joint: Annotated[str, "Its name."]
    degc: Annotated[tuple[float, ...], "Motor temperatures. [degC]"]
    middle: Annotated[tuple[Number, ...], "Median of the robots; None: fewer than three. [-]"]
    low: Annotated[tuple[Number, ...], "A tenth of the robots lie below. [-]"]
    high: Annotated[tuple[Number, ...], "A tenth of the robots lie above. [-]"]
    robots: Annotated[Texts, "Names of those with a finding on this joint: their curves follow."]
    by_degc: Annotated[tuple[tuple[Number, ...], ...], "Measured over model friction of each. [-]"]
    weeks_ns: Annotated[tuple[int, ...], "Middle of each week. [ns since 1970]"]
    week_low: Annotated[tuple[Number, ...], "Over time: a tenth of the robots lie below. [-]"]
    week_middle: Annotated[tuple[Number, ...], "Median of the robots. [-]"]
    week_high: Annotated[tuple[Number, ...], "A tenth lie above. [-]"]
    by_week: Annotated[tuple[tuple[Number, ...], ...], "The same of each week. [-]"]


class FleetReport(Result, name="fleet_report"):
    """Energy and condition of a fleet."""

    dataset: Annotated[str, "Folder of the dataset."]
    model_ids: Annotated[Texts, "Ids of the models used."]
    start_ns: Annotated[int | None, "Start of the first bag. [ns since 1970]"]
    end_ns: Annotated[int | None, "End of the last bag. [ns since 1970]"]
    bags: Annotated[int, "Number of bags read."]
    refused: Annotated[tuple[RefusedBag, ...], "Bags that could not be read."]
    damaged: Annotated[
        tuple[DamagedBag, ...], "Bags that are damaged or doubtful: what was read of them counts."
    ]
    robots: Annotated[tuple[RobotEnergy, ...], "By name."]
    programmes: Annotated[tuple[ProgrammeEnergy, ...], "The most frequent first."]
    shifts: Annotated[tuple[ShiftEnergy, ...], "In the order of the day."]
    model_errors: Annotated[tuple[ModelError, ...], "From cold to warm."]
    findings: Annotated[
        tuple[FleetFinding, ...],
        "Findings that need attention, those of one robot together, the most certain first.",
    ]
    friction: Annotated[tuple[FrictionCurve, ...], "Of each joint, in the order of the model."]
    comparisons: Annotated[int, "Number of kinds of figures by which robots were compared."]
    compared_with_sisters: Annotated[int, "Number of robots with enough sisters and bags for that."]
    compared_with_before: Annotated[int, "Number of robots compared with themselves before."]
    not_compared: Annotated[Texts, "How many robots could not be compared, and what that needs."]
    notes: Annotated[Texts, "What a reader should know, one sentence each."]


class FleetTorqueScore(Result):
    """Torque of bags that the fit has not seen, with the new friction and with that before."""

    joint: Annotated[str, "Its name."]
    rms: Annotated[float, "RMS error of the friction torque. [N m]"]
    rms_before: Annotated[float, "The same with the model that the bags were run with. [N m]"]
    energy_error: Annotated[Number, "Predicted over measured friction energy minus 1. [-]"]
    energy_error_before: Annotated[Number, "The same with that model. [-]"]


class FleetFriction(Result, name="fleet_friction"):
    """One friction model from all bags of a fleet."""

    dataset: Annotated[str, "Folder of the dataset."]
    bags: Annotated[int, "Number of bags used."]
    robots: Annotated[int, "Number of robots used."]
    axes: Annotated[tuple[FrictionFit, ...], "Friction of each joint."]
    refused: Annotated[Texts, "Why other joints could not be identified, one sentence each."]
    held_out: Annotated[
        tuple[FleetTorqueScore, ...],
        "Errors on the newest fifth of the bags, of a fit that has not seen them.",
    ]
    left_out: Annotated[Texts, "Robots whose friction differs from that of their sisters."]
