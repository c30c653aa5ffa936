"""One cycle of a drawn plant with one payload, on the rig and through the pipeline, summed up.

Temperatures are held at `COULOMB_DEGC`; `wear_rows` makes any other of the sums.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from robot_energy.condition.joint_friction import MotionReader
from robot_energy.model import RobotModel
from robot_energy.model.payload import Payload
from robot_energy.physics.friction import FrictionModel
from robot_energy.timeline.blocks import Float, Int, Learning, PowerBlock
from robot_energy_plan.motion.ptp import Program
from robot_energy_rig import PlantProfile, RigConfig, VirtualRig
from robot_energy_rig.plant import COULOMB_DEGC, PlantFriction
from robot_energy_studies.learning_study import joint_block, pipeline_of

RATE = 25.0  # of the joint states [Hz]


@dataclass(frozen=True)
class CycleSums:
    """One cycle with one payload: P parts, n joints.

    Attributes:
        sums: Of plant: rigid, dry, viscous, drag; of monitor: rigid, Coulomb, viscous;
            shape (7, P, 2, n, SPEED_BUCKETS). [N m s], viscous of the monitor [rad]
        time: In motion, shape (P, 2, n, SPEED_BUCKETS). [s]
        load: Sum of the amount of the monitor's rigid torque, shape (P, 2, n). [N m s]
        square: Means of the products of (rigid + drag, dry, viscous), shape (P, 3, 3, n).
            [N^2 m^2]
        power: Means of speed times (drag, dry, viscous), shape (P, 3, n). [W]
        own: Of the monitor, speed times Coulomb and viscous friction, shape (P, 2, n). [W]
        grid: Power of the grid at `COULOMB_DEGC`, true and predicted, shape (P, 2). [W]
        rest: The same while the robot waits at its first pose, shape (2,). [W]
    """

    sums: Float
    time: Float
    load: Float
    square: Float
    power: Float
    own: Float
    grid: Float
    rest: Float


def cycle_sums(
    profile: PlantProfile,
    model: RobotModel,
    program: Program,
    seed: int,
    part: float,
    parts: int,
    carried: list[Payload],
    known: Payload | None,
) -> CycleSums:
    """Return the sums of one cycle.

    Args:
        part: What is summed up together. [s]

    Raises:
        ValueError: If a part has no torque.
    """
    law = FrictionModel.from_model(model)
    hard = RigConfig.hard()
    config = replace(hard, warming=False, stamp_jitter=False)
    length = parts * part
    rig = VirtualRig(profile, program, config, seed, COULOMB_DEGC, COULOMB_DEGC, rate_hz=RATE)
    if carried:
        rig.change(payload=carried)
    pipeline = pipeline_of(model, Learning.OBSERVE, True)
    if known is not None:
        pipeline.torque.set_payload(known)
    learner = pipeline.condition
    blocks: list[PowerBlock] = []
    learner.step = lambda block, _: blocks.append(block)  # type: ignore[method-assign]
    rows = round((length + 1.0) * RATE)  # the derivative is late
    output = rig.step(rows)
    pipeline.step(joint_block(output.joints), output.temperatures, None)
    block = PowerBlock.concatenate(blocks)
    truth = output.truth
    place = np.searchsorted(truth.stamp_ns, block.stamp_ns)
    inside = place < round(length * RATE)
    block, place = block[inside], place[inside]
    speed = truth.motor_velocity
    rigid = truth.motor_torque - truth.motor_torque_friction
    cold = np.full(profile.n_joints, COULOMB_DEGC)
    whole = PlantFriction(profile, hard, 1.0 / RATE).torque(speed, rigid, cold)
    reference = profile.hard.viscous_speed
    turning = (
        np.sign(speed) * reference * (np.abs(speed) / reference) ** (profile.hard.viscous_exponent)
    )
    viscous = PlantFriction(profile, hard, 1.0 / RATE).viscous(cold) * turning
    dry = whole - viscous
    drag = truth.iron_loss / np.where(speed == 0, 1.0, speed)
    plant = np.stack([rigid, dry, turning, drag])[:, place]
    measured = block.motor_velocity
    zero, unit = np.zeros_like(measured), np.ones_like(measured)
    own = law.torque(
        measured,
        law.coulomb * unit,
        zero,
        motor_torque_rigid=block.rigid_power / measured,
        standing=measured == 0,
    )
    number = (place / (part * RATE)).astype(int)
    basis = [*plant, block.rigid_power / measured, own, measured]
    sums = np.array([_summed(learner.reader, block, each, number, parts)[0] for each in basis])
    _, time, load_sum = _summed(learner.reader, block, zero, number, parts)
    terms = np.stack([rigid + drag, dry, turning])[:, place]
    driven = np.stack([drag, dry, turning])[:, place] * speed[place]
    grid = np.stack([truth.grid_power[place], block.supply.grid_power], axis=1)

    def mean(values: Float) -> Float:
        return np.array([values[number == one].mean(axis=0) for one in range(parts)])

    return CycleSums(
        sums,
        time,
        load_sum,
        mean(np.einsum("atn,btn->tabn", terms, terms)),
        mean(np.einsum("atn->tan", driven)),
        mean(np.stack([own * measured, measured**2], axis=1)),
        mean(grid),
        grid[: round(RATE)].mean(axis=0),
    )


def _summed(
    reader: MotionReader, block: PowerBlock, torque: Float, number: Int, parts: int
) -> tuple[Float, Float, Float]:
    """Sums of a torque along the motion, of time and load, part by part."""
    shown = replace(block, shaft_power_measured=torque * block.motor_velocity)
    bare = replace(shown, rigid_power=np.zeros_like(torque))
    model = np.abs(block.motor_velocity) + 1e-9
    found: list[Float] = []
    times: list[Float] = []
    loads: list[Float] = []
    for one in range(parts):
        rows = np.flatnonzero(number == one)
        piece = slice(rows[0], rows[-1] + 1)
        sums = reader.read(bare[piece], model[piece])
        whole = reader.read(shown[piece], model[piece])
        if sums is None or whole is None:
            raise ValueError(f"part {one} of the program has no torque; expected torque")
        found.append(sums.measured)
        times.append(sums.time)
        loads.append(whole.load)
    return np.array(found), np.array(times), np.array(loads)
