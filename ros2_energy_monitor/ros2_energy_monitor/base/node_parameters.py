# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Parameters of the nodes: one frozen dataclass each, with default, range and meaning."""

from __future__ import annotations

from dataclasses import dataclass

from robot_energy.foundation.errors import ParameterError
from robot_energy.inputs.auxiliary import AuxiliaryInputs
from robot_energy.inputs.meter.source import MeterInputs
from robot_energy.inputs.parameters import parameter, setting
from robot_energy.inputs.sources import GapInputs, JointStateInputs, TemperatureInputs

MAX_ROUNDING = 1e-3  # of a number of ticks, so that 8.333 counts as a third of 25


@dataclass(frozen=True, kw_only=True)
class Common:
    """What every monitor needs."""

    model: str = parameter("Model file of the robot, or the name of a shipped model, e.g. kr16.")
    tick_rate: float = parameter(
        "How often results are published; waiting messages are processed together, at the last "
        "tick within each 160 ms [1/s].",
        25.0,
        (1.0, 1000.0),
    )
    autostart: bool = parameter(
        "Whether the node configures and activates itself; if not, a life cycle manager does.",
        True,
    )
    strict_parameters: bool = parameter(
        "Whether an unknown parameter, or a parameter file for other nodes, ends the node.", False
    )
    input_timeout: float = parameter(
        "Time without a message after which diagnostics report an input as missing [s].",
        1.0,
        (0.05, 3600.0),
    )
    resubscribe_after: float = parameter(
        "Time without a message after which the node subscribes again to an input that has "
        "publishers [s].",
        10.0,
        (0.5, 3600.0),
    )


@dataclass(frozen=True, kw_only=True)
class TorqueParameters(JointStateInputs, Common):
    """Parameters of the torque monitor."""

    joint_state_depth: int = parameter(
        "Messages that can wait between two ticks; at least 0.5 s of joint states [messages].",
        2000,
        (1, 100_000),
    )
    derivative_window: float = setting("derivative_window", 0.02, (0.001, 1.0))
    derivative_lag: float = parameter(
        "How far that window reaches beyond the sample; 2.5 times as far where velocities come "
        "from the positions; -1 for half the window [s].",
        -1.0,
        (-1.0, 1.0),
    )


@dataclass(frozen=True, kw_only=True)
class FrictionParameters(TemperatureInputs, Common):
    """Parameters of the friction monitor."""


@dataclass(frozen=True, kw_only=True)
class AccountParameters(AuxiliaryInputs, MeterInputs, Common):
    """What the nodes that keep an energy account share."""

    power_rate: float = parameter(
        "Rate of energy/power, whose powers are means over its period: tick_rate, or tick_rate "
        "divided by a whole number [1/s].",
        25.0,
        (0.1, 1000.0),
    )
    state_folder: str = parameter(
        "Folder in which the registers are kept across restarts; variables such as $HOME are read, "
        "and $ROS_HOME is ~/.ros where it is not set. none: they are not kept.",
        "$ROS_HOME/robot_energy",
    )
    checkpoint_period: float = parameter(
        "Time from one checkpoint to the next: the registers are written to disk and published "
        "[s].",
        1.0,
        (0.1, 3600.0),
    )
    learning: str = setting("learning", "observe")


@dataclass(frozen=True, kw_only=True)
class PowerParameters(GapInputs, AccountParameters):
    """Parameters of the power monitor."""

    joint_torque_depth: int = parameter(
        "Messages that can wait between two ticks; at least 0.5 s of torques [messages].",
        2000,
        (1, 100_000),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_power_rate(self)


@dataclass(frozen=True, kw_only=True)
class EnergyParameters(TorqueParameters, FrictionParameters, AccountParameters):
    """Parameters of the energy monitor, the three monitors in one process."""

    publish_torque: bool = parameter(
        "Whether energy/joint_torque is published, at the full rate of the joint states.", False
    )
    model_check: float = parameter(
        "Time in motion after which the model is checked once against what the robot did, in a "
        "process of low priority; 0 for never [s].",
        20.0,
        (0.0, 600.0),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_power_rate(self)


@dataclass(frozen=True, kw_only=True)
class RobotParameters:
    """Parameters of the virtual robot."""

    seed: int = parameter("Seed of the noise of all sensors.", 1, (0, 2**31 - 1))
    program: int = parameter(
        "Seed of the random program; the same number gives the same motions.", 1, (0, 2**31 - 1)
    )
    speed: float = parameter(
        "Speed of the program, as a share of the limits [-].", 1.0, (0.05, 1.0)
    )
    rate: float = parameter("Rate of the joint states [1/s].", 250.0, (10.0, 4000.0))
    tick_rate: float = parameter(
        "How often the samples that are due are computed [1/s].", 50.0, (1.0, 1000.0)
    )
    start_temperature_degc: float = parameter(
        "Temperature of all motors and gears at the start [degC].", 20.0, (-20.0, 120.0)
    )
    ambient_degc: float = parameter("Temperature of the hall [degC].", 20.0, (-20.0, 60.0))
    thermal_speedup: float = parameter(
        "How many times faster than a real robot it warms up [-].", 1.0, (0.01, 10_000.0)
    )
    plant_seed: int = parameter(
        "Seed by which friction, losses and constants are drawn at random; -1 takes those of the "
        "KR 16 class profile.",
        -1,
        (-1, 2**31 - 1),
    )
    hard: bool = parameter(
        "Whether the rig has effects that no model file has a term for, such as elastic joints.",
        False,
    )
    auxiliary: bool = parameter(
        "Whether a pump and an extruder run next to the robot: their meters on "
        "auxiliary/NAME/power, the numbers of their states on auxiliary/NAME/state.",
        False,
    )


@dataclass(frozen=True, kw_only=True)
class ConsoleParameters:
    """Parameters of the console."""

    refresh_rate: float = parameter(
        "How often the table is drawn on a terminal [1/s].", 4.0, (0.1, 20.0)
    )
    line_period: float = parameter(
        "Time from one printed line to the next where there is no terminal [s].", 5.0, (0.5, 3600.0)
    )


@dataclass(frozen=True, kw_only=True)
class DashboardParameters:
    """Parameters of the energy dashboard."""

    address: str = parameter(
        "IP address to listen on; any other than 127.0.0.1 needs a token.", "127.0.0.1"
    )
    port: int = parameter("TCP port; 0 for any free one.", 8421, (0, 65535))
    token_file: str = parameter("File with the token of the page; empty for none.", "")
    allow_control: bool = parameter(
        "Whether the page has buttons for job intervals and the reset; they need the token.", False
    )
    allowed_hosts: tuple[str, ...] = parameter(
        "Further host names under which the page is served, such as that of a proxy.", ()
    )
    robots: tuple[str, ...] = parameter(
        "Namespaces of the robots to show; empty shows all whose energy/power is found.", ()
    )
    update_rate: float = parameter("How often the page is updated [1/s].", 10.0, (1.0, 20.0))
    page_settings: str = parameter(
        "File with prices, emission factor and length of a shift; empty for none.", ""
    )
    history_folder: str = parameter(
        "Folder of the history that energy_recorder writes; variables such as $HOME are read. "
        "none: no history is shown.",
        "$ROS_HOME/robot_energy/history",
    )


def _check_power_rate(parameters: AccountParameters) -> None:
    """Refuse a rate of energy/power that ticks cannot give evenly."""
    rate, tick_rate = parameters.power_rate, parameters.tick_rate
    whole = max(1, round(tick_rate / rate))
    if abs(tick_rate / rate - whole) > MAX_ROUNDING * whole:
        near = sorted({tick_rate / max(1, whole + step) for step in (-1, 0, 1)})
        raise ParameterError(
            f"power_rate is {rate:g} at a tick_rate of {tick_rate:g}",
            f"tick_rate, or tick_rate divided by a whole number, such as "
            f"{' or '.join(f'{value:.6g}' for value in near)}",
        )
