"""The whole chain in one object: the same for live, replay and prediction."""

from __future__ import annotations

from typing import Annotated

from robot_energy.accounting.account import EnergyAccount
from robot_energy.accounting.averaging import MeanBlock
from robot_energy.accounting.meter_response import MeterResponse
from robot_energy.condition.learner import ConditionLearner
from robot_energy.foundation.described import Described
from robot_energy.model import RobotModel
from robot_energy.physics.drivetrain import motor_rest
from robot_energy.pipeline.friction_stage import FrictionStage
from robot_energy.pipeline.power_stage import PowerStage
from robot_energy.pipeline.settings import Settings
from robot_energy.pipeline.torque_stage import TorqueStage
from robot_energy.timeline.blocks import (
    FrictionBlock,
    JointBlock,
    MeterBlock,
    PowerBlock,
    TemperatureBlock,
    TorqueBlock,
)

TOGETHER_NS = 60_000_000  # of stamps that go through the stages together, at least [ns]


class Output(Described):
    """What one step of the pipeline gave; None where nothing was complete."""

    torque: Annotated[TorqueBlock | None, "Rigid-body torques."] = None
    friction: Annotated[FrictionBlock | None, "New friction coefficients."] = None
    power: Annotated[PowerBlock | None, "Power samples."] = None
    means: Annotated[MeanBlock | None, "Ended averaging periods."] = None
    meter: Annotated[MeterBlock | None, "Meter readings, as they were taken in."] = None
    temperatures: Annotated[TemperatureBlock | None, "Motor temperatures, likewise."] = None


class EnergyPipeline:
    """Torque, friction, power and the energy account, wired directly.

    Any cutting of the same input into steps gives the same output. A step costs nearly the same
    for one sample and for a hundred, so joint states wait until there are 60 ms of them.

    Args:
        model: The robot's model.
        settings: Windows, waiting and averaging.

    Attributes:
        condition: What is learned of the robot.

    Raises:
        RobotEnergyError: If the model cannot be used.
    """

    def __init__(self, model: RobotModel, settings: Settings | None = None) -> None:
        settings = settings or Settings()
        self.model = model
        self.torque = TorqueStage(model, settings)
        self.friction = FrictionStage(model)
        self.condition = ConditionLearner(model, settings)
        self.power = PowerStage(model, settings, self.condition)
        self.account = EnergyAccount(
            len(model.joints), settings, MeterResponse.of(model), motor_rest(model)
        )
        self._waiting: list[JointBlock] = []
        self._done_ns: int | None = None  # newest joint state that did not wait [ns]

    def step(
        self,
        joints: JointBlock | None = None,
        temperatures: TemperatureBlock | None = None,
        meter: MeterBlock | None = None,
        *,
        planned: bool = False,
        torque: TorqueBlock | None = None,
    ) -> Output:
        """Take what has arrived and return what became complete.

        Args:
            joints: Joint states in time order.
            temperatures: Motor temperatures in order of their stamps.
            meter: Meter readings in order of arrival.
            planned: Whether the joints are those of a planned motion, whose accelerations are
                known and not derived.
            torque: What `torque` gave for joint states, where it was asked elsewhere.

        Returns:
            The completed samples of every stage.
        """
        if joints is not None:
            if planned:
                torque = self.torque.plan(joints)
            elif len(joints):
                self._waiting.append(joints)
                newest = self.torque.newest_ns = int(joints.stamp_ns[-1])
                done = self._done_ns
                if done is None or not 0 <= newest - done < TOGETHER_NS:  # enough, or a jump
                    waiting, self._waiting, self._done_ns = self._waiting, [], newest
                    torque = self.torque.step(JointBlock.concatenate(waiting))
        friction = self.friction.step(temperatures) if temperatures is not None else None
        if friction is not None:
            self.power.timeline.add(friction)
        if meter is not None:
            self.account.measure(meter)
            self.condition.measure(meter)
        power = self.power.step(torque) if torque is not None else None
        means = self.account.step(power) if power is not None else None
        return Output(torque, friction, power, means, meter, temperatures)

    def restart(self) -> None:
        """Drop the samples that wait, as after an error; the account and the settings stay."""
        self._waiting.clear()
        self.torque.restart()
        self.power.restart()

    def flush(self) -> Output:
        """Complete what still waits, as at the end of a bag."""
        waiting, self._waiting = self._waiting, []
        parts = [self.torque.step(JointBlock.concatenate(waiting)) if waiting else None]
        found = [part for part in (*parts, self.torque.flush()) if part is not None]
        return self.finish(TorqueBlock.concatenate(found) if found else None)

    def finish(self, torque: TorqueBlock | None) -> Output:
        """Complete what still waits behind the torque.

        Args:
            torque: The last one, if any.

        Returns:
            The completed samples of the stages behind the torque.
        """
        parts = [
            self.power.step(torque) if torque is not None else None,
            self.power.flush(),
        ]
        blocks = [part for part in parts if part is not None]
        power = PowerBlock.concatenate(blocks) if blocks else None
        means = [] if power is None else [self.account.step(power)]
        ended = [mean for mean in (*means, self.account.flush()) if mean is not None]
        return Output(torque, None, power, MeanBlock.concatenate(ended) if ended else None)
