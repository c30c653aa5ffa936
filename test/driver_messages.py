"""What the drivers of robots publish, as bags.

The message definitions are facts of the drivers' interfaces, comments left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from robot_energy.model import RobotModel, validate
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.pipeline import Settings, TorqueStage
from robot_energy.timeline.blocks import EffortMeaning, JointBlock
from robots import figure, joint_block

SECOND = 10**9
START = 1_700_000_000 * SECOND
DELAY = 2_000_000  # from the stamp to the recording [ns]
HEADER = "std_msgs/Header header\n"
LAYOUT = "{0}/MultiArrayDimension[] dim\nuint32 data_offset\n"
DIMENSION = "string label\nuint32 size\nuint32 stride\n"
DEFINITIONS = {
    "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec\n",
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "std_msgs/msg/MultiArrayDimension": DIMENSION,
    "std_msgs/msg/MultiArrayLayout": LAYOUT.format("std_msgs"),
    "std_msgs/msg/Float64MultiArray": "std_msgs/MultiArrayLayout layout\nfloat64[] data\n",
    "sensor_msgs/msg/JointState": (
        HEADER + "string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
    ),
    "example_interfaces/msg/MultiArrayDimension": DIMENSION,
    "example_interfaces/msg/MultiArrayLayout": LAYOUT.format("example_interfaces"),
    "example_interfaces/msg/Float64MultiArray": (
        "example_interfaces/MultiArrayLayout layout\nfloat64[] data\n"
    ),
    "example_interfaces/msg/Float64": "float64 data\n",
    "control_msgs/msg/InterfaceValue": "string[] interface_names\nfloat64[] values\n",
    "control_msgs/msg/DynamicJointState": (
        HEADER + "string[] joint_names\ncontrol_msgs/InterfaceValue[] interface_values\n"
    ),
    "control_msgs/msg/Keys": HEADER + "string[] keys\n",
    "control_msgs/msg/Float64Values": HEADER + "float64[] values\n",
    # lbr_fri_idl of lbr_fri_ros2_stack
    "lbr_fri_idl/msg/LBRState": (
        "float64 sample_time\nint8 session_state\nint8 connection_quality\nint8 safety_state\n"
        "int8 operation_mode\nint8 drive_state\nint8 client_command_mode\nint8 overlay_type\n"
        "int8 control_mode\nuint32 time_stamp_sec\nuint32 time_stamp_nano_sec\n"
        "float64[7] measured_joint_position\nfloat64[7] commanded_joint_position\n"
        "float64[7] measured_torque\nfloat64[7] commanded_torque\nfloat64[7] external_torque\n"
        "float64[7] ipo_joint_position\nfloat64 tracking_performance\n"
    ),
    # xarm_ros2
    "xarm_msgs/msg/RobotMsg": (
        HEADER + "int16 state\nint16 mode\nint16 cmdnum\nint16 mt_brake\nint16 mt_able\n"
        "int16 err\nint16 warn\nfloat32[] angle\nfloat32[6] pose\nfloat32[6] offset\n"
    ),
    # kuka_rsi_driver
    "kuka_driver_interfaces/msg/KssStatus": (
        "uint8 control_mode\nuint8 cycle_time\nbool drives_powered\nbool emergency_stop\n"
        "bool guard_stop\nbool in_motion\nbool motion_possible\nuint8 operation_mode\n"
        "bool robot_stopped\n"
    ),
}

Message = tuple[int, str, str, Any]  # stamp [ns], topic, type, message


class Driver:
    """Makes the messages of one driver.

    Args:
        joints: Names of the joints, as the driver says them.
    """

    def __init__(self, joints: Sequence[str]) -> None:
        self.joints = list(joints)
        self.store = get_typestore(Stores.EMPTY)
        for name, text in DEFINITIONS.items():
            if name not in self.store.fielddefs:
                self.store.register(get_types_from_msg(text, name))

    def new(self, msgtype: str, *fields: Any) -> Any:
        """A message with its fields in order."""
        return self.store.types[msgtype](*fields)

    def header(self, stamp_ns: int, frame: str = "") -> Any:
        """A header."""
        stamp = self.new("builtin_interfaces/msg/Time", stamp_ns // SECOND, stamp_ns % SECOND)
        return self.new("std_msgs/msg/Header", stamp, frame)

    def joint_states(
        self,
        block: JointBlock,
        topic: str,
        frame: str = "base_link",
        names: Sequence[str] = (),
        every: int = 1,
    ) -> Iterator[Message]:
        """Joint states of every so manyth sample."""
        arrays = (block.joint_position, block.joint_velocity, block.joint_effort)
        for row in range(0, len(block), every):
            stamp = int(block.stamp_ns[row])
            values = [array[row].copy() for array in arrays]
            fields = (self.header(stamp, frame), list(names or self.joints), *values)
            msgtype = "sensor_msgs/msg/JointState"
            yield stamp, topic, msgtype, self.new(msgtype, *fields)

    def array(self, stamp: int, topic: str, values: Sequence[float], package: str) -> Message:
        """A Float64MultiArray of one of the two packages that have it."""
        layout = self.new(f"{package}/msg/MultiArrayLayout", [], 0)
        msgtype = f"{package}/msg/Float64MultiArray"
        return stamp, topic, msgtype, self.new(msgtype, layout, np.asarray(values, dtype=float))

    def write(self, folder: Path, messages: Sequence[Message]) -> Path:
        """Record messages, each a little after its stamp."""
        bag = folder / "bag"
        with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            topics: dict[str, Any] = {}
            for stamp, topic, msgtype, message in sorted(messages, key=lambda entry: entry[0]):
                if topic not in topics:
                    topics[topic] = writer.add_connection(topic, msgtype, typestore=self.store)
                data = self.store.serialize_cdr(message, msgtype)
                writer.write(topics[topic], stamp + DELAY, data)
        return bag


def motion(
    n_joints: int, rate: float, seconds: float, centre: Sequence[float] | None = None
) -> JointBlock:
    """All joints swing, each with a frequency of its own; stamps from START."""
    time = np.arange(round(rate * seconds)) / rate
    omega = 2 * np.pi * (0.25 + 0.05 * np.arange(n_joints))
    phase = omega * time[:, None] + np.arange(n_joints)
    middle = np.zeros(n_joints) if centre is None else np.asarray(centre)
    block = joint_block(
        START / SECOND + time, middle + 0.4 * np.sin(phase), 0.4 * omega * np.cos(phase)
    )
    stamps = START + np.round(time * SECOND).astype(np.int64)
    return replaced(block, stamp_ns=stamps)


def replaced(block: JointBlock, **changes: Any) -> JointBlock:
    """A block with other columns."""
    from dataclasses import replace

    return replace(block, **changes)


def effort_of(model: RobotModel, block: JointBlock, meaning: EffortMeaning) -> np.ndarray:
    """What a driver of a robot without friction would send, shape (N, n)."""
    stage = TorqueStage(model, Settings(derivative_window=0.1))
    parts = [part for part in (stage.step(block), stage.flush()) if part is not None]
    torque = np.concatenate([part.motor_torque_rigid for part in parts])
    stamps = np.concatenate([part.stamp_ns for part in parts])
    whole = np.stack(
        [np.interp(block.stamp_ns, stamps, column) for column in torque.T.tolist()], axis=1
    )
    if meaning is EffortMeaning.MOTOR_CURRENT:
        constants = [joint.torque_constant for joint in model.joints]
        return whole / np.array([0.0 if one is None else one.value for one in constants])
    if meaning is EffortMeaning.JOINT_TORQUE:
        return Drivetrain.from_model(model).joint_torque_from_motor(whole)
    return whole


def chain_model(joints: Sequence[str]) -> RobotModel:
    """An arm whose joints turn about z and y in turns, for robots without a shipped model."""
    links = "".join(
        f'<link name="link_{number}"><inertial><origin xyz="0.05 0 0.1"/><mass value="{mass}"/>'
        '<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        for number, mass in enumerate(np.linspace(4.0, 1.0, len(joints)))
    )
    turning = "".join(
        f'<joint name="{name}" type="continuous"><parent link="{parent}"/>'
        f'<child link="link_{number}"/><origin xyz="0 0 0.2"/>'
        f'<axis xyz="{"0 1 0" if number % 2 else "0 0 1"}"/></joint>'
        for number, name in enumerate(joints)
        for parent in ["base" if number == 0 else f"link_{number - 1}"]
    )
    friction = {"coulomb": figure(0.02), "viscous": {"law": "constant", "viscous": figure(1e-4)}}
    entry = {"gear_ratio": figure(100.0), "rotor_inertia": figure(1e-5), "friction": friction}
    return validate(
        {
            "schema_version": 1,
            "robot": {"type": "chain"},
            "urdf": {"xml": f'<robot name="chain"><link name="base"/>{links}{turning}</robot>'},
            "joints": [{"name": name, **entry} for name in joints],
            "cabinet": {"loss_grid": figure(30.0), "loss_dc": figure(10.0)},
            "temperature": {"fallback_degc": 30},
        },
        "chain",
    )
