# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Node parameters -> settings of the pipeline, the same in every node."""

from __future__ import annotations

from dataclasses import replace

from robot_energy.inputs.sources import GapInputs
from robot_energy.pipeline import Settings
from robot_energy.timeline.blocks import EffortMeaning, Learning
from ros2_energy_monitor.base.node_parameters import (
    Common,
    EnergyParameters,
    PowerParameters,
    TorqueParameters,
)


def settings_of(parameters: Common) -> Settings:
    """Return the settings that a node's parameters mean; others keep their defaults."""
    settings = Settings()
    if isinstance(parameters, GapInputs):
        settings = replace(settings, max_gap=parameters.max_gap)
    if isinstance(parameters, TorqueParameters):
        lag = parameters.derivative_lag
        settings = replace(
            settings,
            derivative_window=parameters.derivative_window,
            derivative_lag=None if lag < 0 else lag,
            effort=EffortMeaning(parameters.joint_states.effort_meaning),
        )
    if isinstance(parameters, PowerParameters | EnergyParameters):
        settings = replace(
            settings,
            power_period=round(parameters.tick_rate / parameters.power_rate) / parameters.tick_rate,
            meter_max_gap=parameters.meter_max_gap,
            learning=Learning(parameters.learning),
        ).with_meter(*parameters.meter.limits)
    return settings
