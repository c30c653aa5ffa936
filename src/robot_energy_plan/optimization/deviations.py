"""What the errors of the model's figures do to an energy, figure by figure.

To first order the error of a predicted energy is ``sum_k D_k x_k`` with independent ``x_k`` of
variance 1: ``D_k`` is the change of the energy when figure k is wrong by its standard deviation;
of figures with a covariance ``C = L L'``, with what column k of L adds to all of them.
Two programs of one robot share these errors, so a saving errs by ``sum_k (D_k - D'_k) x_k``: what
both have in common cancels. Here friction and drive losses have a column for each figure, other
than in `robot_energy.certainty.deviation`, as slower motion takes another share of each.

What the form of friction and drive losses leaves out is a curve over speed that nobody knows. It
is taken as a share ``e(|w|)`` of these losses, linear between the speeds of `KNOTS`, with
independent values there: losses at one speed have the same error, at other speeds another. Two more
columns are for what the form of the cabinet leaves out: the power at rest, which is not a constant
(fans), and the energy that drives feed back, of which a DC link keeps a part that its model does
not have. And each place of rest has a column of its own, for what holding there costs.

The constants were chosen on plants 100 to 111, 300 to 313 and 400 to 423 of the rig
(src/doc/decisions/0105); how often bands hold was counted on others.
"""

from __future__ import annotations

import numpy as np

from robot_energy.certainty.figure_deviations import FigureDeviations, known_together
from robot_energy.certainty.friction_certainty import FrictionCertainty
from robot_energy.model import RobotModel
from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy.physics.drives_and_cabinet import FanStage, drive_from_model
from robot_energy.physics.drivetrain import Drivetrain, motor_standstill
from robot_energy.physics.hold_torque import HoldTorque
from robot_energy.physics.rigid_body import Robot
from robot_energy.pipeline import Output
from robot_energy.timeline.blocks import NANOSECOND, Float, PowerBlock


class ConsecutiveBlocks:
    """Puts the last row of the block before in front of each block."""

    def __init__(self) -> None:
        self._last: PowerBlock | None = None

    def joined(self, block: PowerBlock) -> tuple[PowerBlock, Float]:
        """Return the block with that row in front, and the time from each row to the next.

        Args:
            block: In time order, shape (N,).

        Returns:
            Block of shape (N + 1,), of (N,) the first time; times of shape one less, 0 where a
            gap divides two rows. [s]
        """
        if self._last is not None:
            block = PowerBlock.concatenate([self._last, block])
        self._last = block[slice(len(block) - 1, None)]
        time = np.diff(block.stamp_ns) * NANOSECOND
        return block, np.where(np.diff(block.segment) == 0, time, 0.0)


KNOTS = np.array([0.0, 0.15, 0.5, 1.0])
"""Speeds over that of the limit, between which the missing form of the losses is linear. [-]"""
FORM = np.array([0.115, 0.06, 0.045, 0.045])
"""Standard deviation of the share of friction and drive losses that their form leaves out, at each
of these speeds. [-]"""
FORM_FED_BACK = 0.2
"""The same of the power that the drives feed back. [-]"""
FORM_OF_HOLDING = 0.022
"""The same of the power at rest, different at each place. [-]"""
CABINET = 3  # columns of the cabinet, which come first


class EnergyDeviations:
    """Rates of the columns ``D_k`` of one robot. [W]"""

    def __init__(self, model: RobotModel) -> None:
        self.figures = FigureDeviations(model)
        self._certainty = FrictionCertainty(model)
        self._fallback_degc = model.temperature.fallback_degc
        kind = DRIVE_MODELS[model.drive]
        entries = kind.entries(self.figures.model.joints)
        self._drive = None if kind.loss_deviations is None else kind.loss_deviations(entries)
        self._lossless = kind.lossless
        ratio = np.abs(Drivetrain.from_model(model).transmission)
        self._top_speed = ratio @ Robot.from_model(model).limits.velocity

    def columns(
        self,
        motor_velocity: Float,
        motor_torque: Float,
        rigid_power: Float,
        friction_power: Float,
        drive_loss: Float,
        held: Float,
        motor_temperature_degc: Float,
        fed_back: Float,
        fan_powers: Float | None = None,
    ) -> Float:
        """Return the rates of all columns while the grid sees all of the bus, shape (N, K). [W]

        Args:
            motor_velocity: 0 where the axis stands, shape (N, n). [rad/s]
            motor_torque: Rigid plus friction, shape (N, n). [N m]
            rigid_power: Shape (N, n). [W]
            friction_power: Shape (N, n). [W]
            drive_loss: Shape (N, n). [W]
            held: Deviation of the loss at rest by what motors hold there, shape (N, n). [W]
            motor_temperature_degc: Shape (n,). [degC]
            fed_back: Power to the brake resistor or back to the grid, shape (N,). [W]
            fan_powers: As of `FigureDeviations.grid_side`, shape (2, N). [W]
        """
        figures, speed = self.figures, np.abs(motor_velocity)
        std, shared = (part[0] for part in self._certainty.std(motor_temperature_degc[None, :]))
        own = np.sqrt(np.maximum(std**2 - shared**2, 0.0))
        square = speed * speed
        bent = None
        if figures.exponent_std is not None:
            bent = figures.by_exponent(motor_velocity, figures.exponent_std)
            square = square * bent[0]
        # With the tag, a payload that was changed in the file adds nothing.
        carried = rigid_power * (0.0 if figures.with_payload else figures.payload_share)
        at_bus = [
            figures.bodies * (rigid_power - carried).sum(axis=1)[:, None],
            figures.payload * carried.sum(axis=1)[:, None],
            (square * shared).sum(axis=1)[:, None],
            speed * figures.coulomb,
            square * own * figures.viscous,
            held,
        ]
        if bent is not None:
            known = np.isfinite(motor_temperature_degc)
            degc = np.where(known, motor_temperature_degc, self._fallback_degc)
            at_bus.append(bent[1] * figures.friction.viscous(degc))
        if self._drive is not None:
            at_bus += list(self._drive(speed, motor_torque))
        elif self._lossless:
            at_bus.append(figures.drive_share * np.abs(rigid_power + friction_power))
        else:
            at_bus.append(figures.drive_share * np.abs(drive_loss))
        place = np.clip(speed / self._top_speed, KNOTS[0], KNOTS[-1])
        lost = friction_power + np.abs(drive_loss)  # divided among the two knots next to the speed
        hats = np.eye(len(KNOTS))
        at_bus += [
            share * lost * np.interp(place, KNOTS, hat)
            for share, hat in zip(FORM, hats, strict=True)
        ]
        if figures.together is not None:
            at_bus.append(known_together(figures.together, speed, motor_torque, square * own))
        cabinet = np.full((len(speed), CABINET), (0.0, figures.at_rest, FORM_FED_BACK))
        cabinet[:, 0] = figures.grid_side(fan_powers)
        cabinet[:, 2] *= fed_back
        loss_dc = np.full((len(speed), 1), figures.loss_dc)
        return np.concatenate([cabinet, loss_dc, *at_bus], axis=1)

    def at_grid(self, columns: Float, reaches: Float) -> Float:
        """Return the rates of columns as the grid sees them, shape (N, K). [W]

        Args:
            columns: Of `columns`, shape (N, K). [W]
            reaches: Share of the power at the bus that the grid sees, shape (N,). [-]
        """
        seen = columns.copy()
        seen[:, CABINET:] *= reaches[:, None]
        if self.figures.together is not None:
            seen[:, -len(self.figures.of_grid) :] += self.figures.of_grid
        return seen


class DeviationSums:
    """Integrates the columns over what a pipeline gave of one motion.

    Attributes:
        braked: Energy into the brake resistor. [J]
        energy: Change of the energy from the grid with the error of each figure, shape (K,). [J]
        brake: The same of the energy into the brake resistor, shape (K,). [J]
    """

    def __init__(self, model: RobotModel) -> None:
        self.braked = 0.0
        self._deviations = EnergyDeviations(model)
        self._standstill = motor_standstill(model)
        self._hold, self._drive = HoldTorque(model), drive_from_model(model)
        self._fan = FanStage(model.cabinet, assumed=True)
        self._fallback_degc = model.temperature.fallback_degc
        self._blocks = ConsecutiveBlocks()
        self.energy: Float = np.zeros(1)
        self.brake: Float = np.zeros(1)

    def take(self, output: Output) -> None:
        """Take what a step of the pipeline gave."""
        if output.power is None:
            return
        block, time = self._blocks.joined(output.power)
        weight = 0.5 * (np.append(time, 0.0) + np.append(0.0, time))
        braking = block.brake_power > 0.0
        self.braked += float(block.brake_power[braking] @ weight[braking])
        excess = braking | (block.grid_power < block.loss_grid)
        fed_back = np.maximum(block.brake_power, np.where(excess, -block.bus_power, 0.0))
        speed = np.where(
            np.abs(block.motor_velocity) <= self._standstill, 0.0, block.motor_velocity
        )
        degc = block.motor_temperature_degc
        held = self._hold.loss_std(
            self._drive,
            block.motor_torque,
            np.where(speed == 0.0, self._hold.std(block.motor_torque), 0.0),
            np.where(np.isnan(degc), self._fallback_degc, degc),
        )
        self._fan.step(degc)
        rows = self._deviations.columns(
            speed,
            block.motor_torque,
            block.rigid_power,
            block.friction_power,
            block.drive_loss,
            held,
            _mean_known(degc),
            fed_back,
            self._fan.powers,
        )
        rows = np.nan_to_num(rows)
        reaches = np.where(braking, 0.0, np.where(excess, self._deviations.figures.returned, 1.0))
        lost = rows * braking[:, None]
        lost[:, :2] = 0.0
        total = self._deviations.at_grid(rows, reaches) * weight[:, None]
        self.energy = self.energy + total.sum(axis=0)
        self.brake = self.brake + (lost * weight[:, None]).sum(axis=0)


def _mean_known(values: Float) -> Float:
    """Mean of each column; NaN, which stands for the fallback, where nothing is known."""
    known = np.isfinite(values)
    count = known.sum(axis=0)
    total = np.where(known, values, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
