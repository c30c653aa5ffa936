"""Recordings as the public functions of identification are given them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from robot_energy.foundation.errors import ModelFileError, ParameterError
from robot_energy.foundation.process_memory import give_back_freed_memory
from robot_energy.inputs.sources import Inputs
from robot_energy.model import RobotModel
from robot_energy.replay.setup import driver_inputs, effort_meaning
from robot_energy.timeline.blocks import EffortMeaning
from robot_energy_identify.data.bags import Bag, Kept, motion_time
from robot_energy_identify.data.observations import Channels
from robot_energy_identify.data.recordings import Recording, channels_of, read_recording
from robot_energy_identify.data.thinned import MOST
from robot_energy_identify.drives.drive_power import DrivePowerTopics
from robot_energy_identify.friction.samples import FrictionData, friction_data
from robot_energy_identify.options import EFFORTS, Stages, silent
from robot_energy_identify.plausibility import check_signs
from robot_energy_identify.refused_recordings import (
    refuse_motion,
    refuse_shared,
    refuse_torque,
    torque_evidence,
)
from robot_energy_identify.run_all import usable_effort
from robot_energy_identify.stats.systematic import DEFAULT_LIMITS, SensorLimits


@dataclass(frozen=True)
class BagSource:
    """Recordings of one robot for identification, and how they are read.

    Attributes:
        effort: What the effort in the joint states is; None: as ``inputs`` says.
        inputs: Parameter file of a monitor: read the bags as that node reads its topics.
        progress: Called with what is going on; gives a function of the share done.
        sensors: Limits of the constant errors of the sensors; None for the usual ones.
    """

    bags: Sequence[str | Path]
    effort: str | None = None
    inputs: str | Path | None = None
    robot: str | None = None
    progress: Stages = silent
    sensors: SensorLimits | None = None

    @property
    def paths(self) -> list[Path]:
        return [Path(bag) for bag in self.bags]

    @property
    def names(self) -> str:
        return ", ".join(path.name for path in self.paths)

    def meaning(self) -> tuple[EffortMeaning, Inputs | None]:
        """Return what the effort means, and the inputs of the parameter file."""
        read, notes = driver_inputs(self.inputs, self.robot)
        if notes:
            raise ParameterError(notes[0], remedy=f"change {self.inputs}")
        stated = EffortMeaning.NONE if read is None else read.joint_states.effort_meaning
        return effort_meaning(self.effort or stated), read

    def recordings(self, model: RobotModel) -> list[Recording]:
        """Return the bags as the stages of the monitor read them."""
        meaning, read = self.meaning()
        sensors = self.sensors or DEFAULT_LIMITS
        found: list[Recording] = []
        most = MOST // max(len(self.bags), 1)
        for bag in self.bags:
            with self.progress(f"reading {Path(bag).name}") as report:
                part = read_recording(bag, model, meaning, report, read, most)
                refuse_motion(part, meaning)
                found.append(replace(part, sensors=sensors))
        refuse_shared(found)
        return found

    def with_effort(self, model: RobotModel) -> list[Recording]:
        """Return bags with measured torque or current as the stages of the monitor read them."""
        meaning, _ = self.meaning()
        if meaning is EffortMeaning.NONE:
            raise ModelFileError(
                f"{self.inputs} does not say what the effort means"
                if self.inputs
                else "it is not said what the effort means",
                f"an effort, one of {', '.join(EFFORTS)}",
                "the effort of a driver is never guessed",
            )
        found = self.recordings(model)
        check_signs(found, meaning)
        with self.progress("comparing with the model"):
            refuse_torque([torque_evidence(part, meaning) for part in found])
        return found

    def friction_data(self, model: RobotModel) -> list[FrictionData]:
        """Return what is needed to identify friction, one entry per joint."""
        recordings = self.with_effort(model)
        return [friction_data(recordings, joint) for joint in range(len(model.joints))]

    def channels(self, model: RobotModel) -> dict[str, list[Channels]]:
        """Return evenly sampled motion and torque of each recording by its name."""
        recordings = self.with_effort(model)
        seconds = motion_time(recordings, len(recordings))
        found: dict[str, list[Channels]] = {}
        rate: float | None = None
        for bag in self.lazy(model, None)[0]:
            kept = Kept(recordings.pop(0))  # which takes more than its motion
            sampled = channels_of(replace(bag, kept=kept).motion(model, seconds), rate)
            rate = sampled[0].rate
            found[str(bag.path) if bag.name in found else bag.name] = sampled
            del kept
        give_back_freed_memory()
        return found

    def lazy(
        self, model: RobotModel, drive_power: DrivePowerTopics | None
    ) -> tuple[list[Bag], str]:
        """Return the bags as identification reads them in parts, and why no effort is used."""
        meaning, read = self.meaning()
        refused = usable_effort(model, meaning)
        used = EffortMeaning.NONE if refused else meaning
        sensors = self.sensors or DEFAULT_LIMITS
        bags: list[Bag] = []
        for path in self.paths:
            power = drive_power and drive_power.read(path, model.joint_names)
            most = MOST // len(self.bags)
            bags.append(Bag(path, used, read, power, sensors=sensors, most=most))
        return bags, refused
