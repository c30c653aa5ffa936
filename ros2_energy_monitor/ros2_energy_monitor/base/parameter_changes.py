# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Parameters that change while a monitor lives: which, when, and why not.

What configure reads can be set while the node is unconfigured or inactive, and counts when it is
configured or activated the next time; whether all values fit together is checked then. While the
node is active only what leaves the registers as they are can be set, and counts at once.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter as RosParameter

from robot_energy.foundation.errors import ParameterError
from robot_energy.inputs.parameters import Parameter
from ros2_energy_monitor.base.lifecycle import ManagedNode

AT_START = ("autostart", "strict_parameters")
"""Read once when the process starts, so that they are read-only."""
AT_ONCE = ("input_timeout", "resubscribe_after", "checkpoint_period")
"""Concern reports, subscriptions and the disk, and no figure."""


class ParameterChanges:
    """Accepts or refuses changes of the parameters of one node.

    Args:
        entries: Gives its parameters by name as they are declared now.
    """

    def __init__(
        self,
        node: ManagedNode,
        entries: Callable[[], Mapping[str, Parameter]],
        changed: Callable[[Sequence[str]], None],
    ) -> None:
        self._node, self._entries, self._changed = node, entries, changed
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._take)

    def _check(self, parameters: list[RosParameter]) -> SetParametersResult:
        """Say whether some parameters can have new values now."""
        entries, node = self._entries(), self._node
        try:
            for parameter in parameters:
                name, entry = parameter.name, entries.get(parameter.name)
                if entry is None:  # of rclpy, or of a group that is in use no longer
                    continue
                value: Any = parameter.value
                entry.check([] if value is None else value, node.get_name())
                if node.active and name not in AT_ONCE:
                    raise ParameterError(
                        f"{node.get_name()} is active, and '{name}' changes what its figures mean",
                        f"one of {', '.join(one for one in AT_ONCE if one in entries)}",
                        "deactivate the node, set it and activate again",
                    )
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _take(self, parameters: list[RosParameter]) -> None:
        """Hand on what has changed."""
        entries = self._entries()
        names = [parameter.name for parameter in parameters if parameter.name in entries]
        if names:
            self._changed(names)
