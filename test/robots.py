"""Small robots whose physics can be worked out by hand, for all tests."""

from __future__ import annotations

from typing import Any

import numpy as np

from robot_energy.model import RobotModel, validate
from robot_energy.timeline.blocks import Float, JointBlock

# Planar two-link arm in the vertical x-z plane, both axes along -y, so that a positive
# angle lifts the arm. Point masses are avoided: real inertias about the centres of mass.
L1, C1, M1, I1 = 0.5, 0.2, 4.0, 0.05  # m, m, kg, kg m^2
C2, M2, I2 = 0.15, 2.0, 0.02
G = 9.81

TWO_LINK_URDF = f"""
<robot name="two_link">
  <link name="base"/>
  <link name="upper">
    <inertial><origin xyz="{C1} 0 0"/><mass value="{M1}"/>
      <inertia ixx="0.001" iyy="{I1}" izz="{I1}" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <link name="fore">
    <inertial><origin xyz="{C2} 0 0"/><mass value="{M2}"/>
      <inertia ixx="0.001" iyy="{I2}" izz="{I2}" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="upper"/><axis xyz="0 -1 0"/>
    <limit lower="-3" upper="3" effort="100" velocity="4"/>
  </joint>
  <joint name="elbow" type="continuous">
    <parent link="upper"/><child link="fore"/><origin xyz="{L1} 0 0"/><axis xyz="0 -1 0"/>
  </joint>
</robot>
"""


def figure(value: float) -> dict[str, Any]:
    """A tagged number."""
    return {"value": value, "tag": "assumed"}


def two_link_data() -> dict[str, Any]:
    """Plain values of the two-link model; change them and validate."""
    return {
        "schema_version": 1,
        "robot": {"type": "two-link arm"},
        "urdf": {"xml": TWO_LINK_URDF},
        "gravity": [0.0, 0.0, -G],
        "joints": [
            {
                "name": "shoulder",
                "gear_ratio": figure(100.0),
                "rotor_inertia": figure(1e-4),
                "friction": {
                    "coulomb": figure(0.1),
                    "viscous": {
                        "law": "exponential",
                        "a": figure(1e-4),
                        "b": figure(1e-3),
                        "c": figure(20.0),
                        "fitted_degc": [20.0, 80.0],
                    },
                },
            },
            {
                "name": "elbow",
                "gear_ratio": figure(-50.0),
                "rotor_inertia": figure(2e-5),
                "friction": {
                    "coulomb": figure(0.05),
                    "viscous": {"law": "constant", "viscous": figure(2e-4)},
                },
            },
        ],
        "coupling": [{"motor": "elbow", "joint": "shoulder", "ratio": figure(10.0)}],
        "cabinet": {"loss_grid": figure(30.0), "loss_dc": figure(20.0)},
        "temperature": {"fallback_degc": 25.0, "stale_after": 5.0},
    }


def two_link(**changes: Any) -> RobotModel:
    """The two-link model with top-level entries replaced."""
    return validate({**two_link_data(), **changes}, "two_link")


def wheel_data() -> dict[str, Any]:
    """One joint about the vertical: no gravity, inertia 2 kg m^2, gear ratio 10."""
    urdf = """
    <robot name="wheel"><link name="base"/><link name="disc">
      <inertial><mass value="8"/>
        <inertia ixx="1" iyy="1" izz="2" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="axle" type="continuous"><parent link="base"/><child link="disc"/>
        <axis xyz="0 0 1"/></joint></robot>"""
    return {
        "schema_version": 1,
        "robot": {"type": "wheel"},
        "urdf": {"xml": urdf},
        "joints": [
            {
                "name": "axle",
                "gear_ratio": figure(10.0),
                "rotor_inertia": figure(0.01),
                "friction": {
                    "coulomb": figure(0.5),
                    "viscous": {"law": "constant", "viscous": figure(0.02)},
                },
            }
        ],
        "cabinet": {"loss_grid": figure(30.0), "loss_dc": figure(20.0)},
        "temperature": {"fallback_degc": 25.0},
    }


def one_wheel(**changes: Any) -> RobotModel:
    """That robot with top-level entries replaced."""
    return validate({**wheel_data(), **changes}, "wheel")


def joint_block(
    stamp_s: Float,
    position: Float,
    velocity: Float,
    acceleration: Float | None = None,
    effort: Float | None = None,
) -> JointBlock:
    """Joint states of one segment from arrays (N,) and (N, n)."""
    size = len(stamp_s)
    return JointBlock(
        stamp_ns=np.rint(np.asarray(stamp_s) * 1e9).astype(np.int64),
        segment=np.zeros(size, dtype=np.int64),
        quality=np.zeros(size, dtype=np.uint32),
        joint_position=position,
        joint_velocity=velocity,
        joint_acceleration=np.full_like(position, np.nan) if acceleration is None else acceleration,
        joint_effort=np.full_like(position, np.nan) if effort is None else effort,
    )
