"""The alternative: the loop a user writes with rosbags and pin.rnea, one message at a time.

It computes the table of `robot-energy replay` (energies predicted and measured, per joint
and phase) with the usual shortcuts of such a script: differences of successive velocities
for the acceleration, the newest temperature, sums in floats, no accounting.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
from rosbags.highlevel import AnyReader

from robot_energy.bag.cdr.types import typestore
from robot_energy.model import load


def main(bag: str, model_name: str) -> None:
    """Print the predicted grid energy of a bag. [J]"""
    model_file = load(model_name)
    names = list(model_file.joint_names)
    robot = pin.buildModelFromXML(model_file.urdf_xml)
    for body in model_file.payload:
        frame = robot.frames[robot.getFrameId(body.link)]
        inertia = pin.Inertia(body.mass, np.array(body.centre_of_mass), np.diag(body.inertia[:3]))
        robot.appendBodyToJoint(frame.parentJoint, inertia, frame.placement)
    data = robot.createData()
    ratio = np.array([joint.gear_ratio.value for joint in model_file.joints])
    rotor = np.array([joint.rotor_inertia.value for joint in model_file.joints])
    coulomb = np.array([joint.friction.coulomb.value for joint in model_file.joints])
    laws = [joint.friction.viscous for joint in model_file.joints]
    a, b, c = (np.array([getattr(law, key).value for law in laws]) for key in "abc")
    loss_dc, loss_grid = model_file.cabinet.loss_dc.value, model_file.cabinet.loss_grid.value

    viscous = a + b * np.exp(-model_file.temperature.fallback_degc / c)
    measured = predicted = brake = 0.0
    positive, negative, rigid_energy, friction_energy = np.zeros((4, len(names)))
    phases = {"hold": 0.0, "motion": 0.0, "generating": 0.0}
    last = last_meter = None
    with AnyReader([Path(bag)], default_typestore=typestore()) as reader:
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            stamp = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
            if connection.topic == "/motor_temperatures":
                order = [message.joint_names.index(name) for name in names]
                viscous = a + b * np.exp(-message.temperature_degc[order] / c)
            elif connection.topic == "/power_meter":
                if last_meter is not None:
                    measured += 0.5 * (message.power + last_meter[1]) * (stamp - last_meter[0])
                last_meter = stamp, message.power
            elif connection.topic == "/joint_states":
                order = [message.name.index(name) for name in names]
                position, velocity = message.position[order], message.velocity[order]
                if last is not None and 0 < stamp - last[0] < 0.1:
                    elapsed = stamp - last[0]
                    acceleration = (velocity - last[1]) / elapsed
                    torque = pin.rnea(robot, data, position, velocity, acceleration) / ratio
                    torque += rotor * ratio * acceleration
                    speed = velocity * ratio
                    rigid = torque * speed
                    friction = (coulomb * np.sign(speed) + viscous * speed) * speed
                    shaft = rigid + friction
                    demand = shaft.sum() + loss_dc
                    predicted += (max(demand, 0.0) + loss_grid) * elapsed
                    brake += max(-demand, 0.0) * elapsed
                    positive += np.maximum(shaft, 0.0) * elapsed
                    negative += np.maximum(-shaft, 0.0) * elapsed
                    rigid_energy += rigid * elapsed
                    friction_energy += friction * elapsed
                    moving = np.abs(velocity).max() > 2e-3
                    phase = "generating" if demand < 0 else "motion" if moving else "hold"
                    phases[phase] += elapsed
                last = stamp, velocity
    print(predicted, measured, brake, positive, negative, rigid_energy, friction_energy, phases)


if __name__ == "__main__":
    main(*sys.argv[1:])
