"""What is claimed to be saved against what the virtual rig saves."""

from __future__ import annotations

from typing import Annotated

from robot_energy.foundation.described import Described
from robot_energy.timeline.blocks import Float
from robot_energy_plan.motion import Program
from robot_energy_plan.motion.ptp import MotionLimits
from robot_energy_plan.optimization.plan import Cost, saving
from robot_energy_rig import PlantProfile, RigConfig, VirtualRig
from robot_energy_studies.band_coverage import AMBIENT

RATE = 250.0  # Hz
UNCHANGED = "unchanged"  # measure of the control


class JudgedClaim:
    """A claim with its band, and the truth; a base of dataclasses with these three fields. [J]"""

    claim: float
    half: float
    truth: float

    @property
    def claimed(self) -> bool:
        """Whether the tool claims it."""
        return self.claim > self.half > 0

    @property
    def inside(self) -> bool:
        """Whether the band holds the truth."""
        return abs(self.truth - self.claim) <= self.half


class JudgedSaving(Described, JudgedClaim):
    """One change of one program at one temperature."""

    plant: int
    degc: Annotated[float, "Temperature of motors and gears. [degC]"]
    measure: str
    base: Annotated[float, "Energy of a cycle on the rig as it was. [J]"]
    claim: Annotated[float, "Saving that the model predicts. [J]"]
    half: Annotated[float, "Half width of its 90 % band. [J]"]
    truth: Annotated[float, "Saving on the rig. [J]"]
    faster: Annotated[float, "Time that a cycle lasts less. [s]"]
    standing: Annotated[float, "Share of losses at rest in the energy, by the model. [-]"]


class JudgedChoice(Described):
    """The choice of the model against the best that the rig itself allows."""

    plant: int
    degc: Annotated[float, "Temperature of motors and gears. [degC]"]
    free: Annotated[bool, "Whether cycles follow each other at once."]
    chosen: Annotated[float, "Energy on the rig of what the model chose. [J]"]
    best: Annotated[float, "Least energy on the rig, of every combination. [J]"]

    @property
    def regret(self) -> float:
        """What the choice costs more. [-]"""
        return self.chosen / self.best - 1.0


class PlantAtWork:
    """A plant that runs programs at one temperature.

    Args:
        degc: Of motors and gears. [degC]
        cycles: Run in turn, of which the last one counts: rests begin as motions left them.
    """

    def __init__(
        self, profile: PlantProfile, degc: float, config: RigConfig | None = None, cycles: int = 1
    ) -> None:
        self._profile, self._degc, self._cycles = profile, degc, cycles
        self._config = (config or RigConfig.hard()).without("warming")

    def power(self, program: Program) -> Float:
        """Return the power from the grid over one cycle, shape (N,). [W]"""
        rig = VirtualRig(self._profile, program, self._config, 0, self._degc, AMBIENT, rate_hz=RATE)
        count = max(1, round(program.period * RATE))
        return rig.step(self._cycles * count).truth.grid_power[-count:]

    def energy(self, program: Program) -> float:
        """Return the energy of one cycle from the grid. [J]"""
        return float(self.power(program).mean()) * program.period


class DrawnWork(Described):
    """One program of one plant at one temperature."""

    plant: int
    degc: Annotated[float, "Temperature of motors and gears. [degC]"]
    program: Program
    limits: MotionLimits
    rig: PlantAtWork

    def judged(
        self,
        measure: str,
        base: float,
        before: Cost,
        after: Cost,
        changed: Program,
        standing: float,
    ) -> JudgedSaving:
        """Return what is claimed of a changed program, and what the rig saves with it.

        Args:
            base: Energy of a cycle on the rig as it was. [J]
            standing: Share of losses at rest in the energy, by the model. [-]
        """
        truth, claim = base - self.rig.energy(changed), saving(before, after)
        return JudgedSaving(
            self.plant, self.degc, measure, base, claim.energy, claim.half, truth,
            before.duration - after.duration, standing,
        )  # fmt: skip
