# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The life cycle of a managed node: four steps to fill in, errors logged in one sentence."""

from __future__ import annotations

import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rosgraph_msgs.msg import Clock

from robot_energy.foundation.errors import ParameterError, RobotEnergyError
from robot_energy.foundation.shown_text import shown
from robot_energy.timeline.stamps import is_valid_time
from ros2_energy_monitor.base.entities import EntitySnapshot
from ros2_energy_monitor.base.guard import Guard
from ros2_energy_monitor.base.publishers import reliable

REQUESTS = 100  # of a service that can wait; the 10 of ROS are lost in silence
RCLError = rclpy_implementation.RCLError
DONE, REFUSED, BROKEN = (
    TransitionCallbackReturn.SUCCESS,
    TransitionCallbackReturn.FAILURE,
    TransitionCallbackReturn.ERROR,
)


class ManagedNode(LifecycleNode, ABC):
    """A node that is configured, activated, deactivated and cleaned up, any number of times.

    A subclass fills in `configure`, `activate`, `deactivate` and `cleanup`, and ends its
    constructor with `autostart`. What a step raises as `RobotEnergyError` refuses the
    transition and is logged in one sentence; any other error is logged whole and takes the
    node back to unconfigured.

    Attributes:
        outdated: Whether parameters have changed since it was configured; activate configures
            it again then.
        bad_clocks: Messages of ``/clock`` left out, as their time is not a stamp.
    """

    def __init__(self, name: str, **options: Any) -> None:
        self.guard = Guard(name, options.get("context"))
        self.bad_clocks = 0
        super().__init__(name, **options)
        service = self._service_change_state
        service.callback = partial(self._asked, service.callback)
        self.active = False
        self.outdated = False
        self._is_configured = False
        self._starting = False
        self._autostart_pending = False
        self._error: Exception | None = None
        self._permanent: EntitySnapshot | None = None

    @abstractmethod
    def configure(self) -> None:
        """Read files and create entities; called by the transition configure."""

    @abstractmethod
    def activate(self) -> None:
        """Start to work; called by the transition activate."""

    @abstractmethod
    def deactivate(self) -> None:
        """Publish what still waits; called by the transition deactivate."""

    @abstractmethod
    def cleanup(self) -> None:
        """Close files; called by the transition cleanup, and after a `configure` that failed."""

    @property
    def state(self) -> str:
        """Label of the state, such as ``inactive``."""
        return str(self._state_machine.current_state[1])

    @property
    def finalized(self) -> bool:
        """Whether the node was shut down and can do nothing any more."""
        return self.state == "finalized"

    @property
    def ready(self) -> bool:
        """Whether nothing is awaited that the node needs before it can be activated."""
        return True

    def autostart(self, *, enabled: bool) -> None:
        """End the constructor; entities created before are kept by cleanup.

        Args:
            enabled: Whether to configure and activate now, or once it is `ready`.

        Raises:
            Exception: What keeps it from starting.
        """
        self._permanent = EntitySnapshot(self)
        if not enabled:
            return
        self._starting = True
        if self.trigger_configure() != DONE or (self.ready and self.trigger_activate() != DONE):
            raise self._error or RuntimeError(f"{self.get_name()} cannot be started")
        self._starting = False
        self._autostart_pending = not self.active

    def resume_autostart(self) -> None:
        """Activate, now that what was awaited at the start is there."""
        if self._autostart_pending:
            self.trigger_activate()

    def close(self) -> None:
        """Become inactive, if active, so that nothing that waits is lost."""
        if self.active:
            self.trigger_deactivate()

    def create_timer(self, period: float, callback: Any, *args: Any, **options: Any) -> Any:
        """Create a timer whose callback no exception leaves.

        Arguments and result as in `rclpy.node.Node.create_timer`.
        """
        guarded = self.guard.callback(f"timer.{_name(callback)}", callback)
        return super().create_timer(period, guarded, *args, **options)

    def create_service(
        self, kind: Any, name: str, callback: Any, *args: Any, **options: Any
    ) -> Any:
        """Create a service that answers in any case; as in `rclpy.node.Node.create_service`."""
        guarded = self.guard.callback(f"service.{name.rpartition('/')[2]}", callback)
        options.setdefault("qos_profile", reliable(REQUESTS))
        return super().create_service(kind, name, guarded, *args, **options)

    def create_subscription(
        self, kind: Any, topic: str, callback: Any, *args: Any, **options: Any
    ) -> Any:
        """Create a subscription whose callback no exception leaves.

        Arguments and result as in `rclpy.node.Node.create_subscription`.

        Raises:
            ParameterError: If another subscription of this process reads the topic as another type.
        """
        if kind is Clock:
            callback = self._stamped(callback)
        guarded = self.guard.callback(f"topic.{topic}", callback)
        try:
            return super().create_subscription(kind, topic, guarded, *args, **options)
        except RCLError as error:
            raise ParameterError(
                f"topic '{topic}' cannot be read as {kind.__name__}" + self._read_as(topic),
                "a topic that no other input of this node reads as another type",
            ) from error

    def _read_as(self, topic: str) -> str:
        """Say as which types this node reads a topic; empty if it does not."""
        name = self.resolve_topic_name(topic)
        types = {_name(one.msg_type) for one in self.subscriptions if one.topic_name == name}
        return f": another input reads it as {', '.join(sorted(types))}" if types else ""

    def resolve_topic_name(self, topic: str, *, only_expand: bool = False) -> str:
        """Return the full name of a topic; as in `rclpy.node.Node.resolve_topic_name`.

        Raises:
            ParameterError: If no topic can have that name.
        """
        try:
            return super().resolve_topic_name(topic, only_expand=only_expand)
        except RCLError as error:
            raise ParameterError(
                f"'{topic}' cannot be the name of a topic",
                "letters, digits, _ and /, such as arm/joint_states",
            ) from error

    def _stamped(self, take: Callable[[Clock], None]) -> Callable[[Clock], None]:
        """Leave out times that no output could carry; rclpy raises for some of them."""

        def stamped(message: Clock) -> None:
            if is_valid_time(message.clock.sec, message.clock.nanosec):
                take(message)
            else:
                self.bad_clocks += 1

        return stamped

    def destroy_node(self) -> None:
        """Destroy the node, its files released before."""
        self.guard.run("release", self._release_all)
        super().destroy_node()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Configure the node; if that fails it stays unconfigured, with nothing left behind.

        Argument and result as in `rclpy.lifecycle.LifecycleNode.on_configure`.
        """

        def configure() -> None:
            self._is_configured = True
            self.outdated = False
            self.configure()

        result = self._run("configured", configure)
        if result == REFUSED:
            self._release_all()
        return result

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start to work; as in `rclpy.lifecycle.LifecycleNode.on_activate`."""

        def activate() -> None:
            if self.outdated:
                pending = self._autostart_pending
                self._release_all()
                self._is_configured = True
                self.configure()
                self.outdated, self._autostart_pending = False, pending
            self.activate()
            self.active = True

        result = self._run("activated", activate)
        if result == REFUSED and self.outdated:  # the next activate configures again
            self._release_all()
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Publish what waits and stop; as in `rclpy.lifecycle.LifecycleNode.on_deactivate`."""
        return self._run("deactivated", self._stop)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release everything, so that the node can be configured again.

        Argument and result as in `rclpy.lifecycle.LifecycleNode.on_cleanup`.
        """
        return self._run("cleaned up", self._release_all)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Publish what waits and release everything for good.

        Argument and result as in `rclpy.lifecycle.LifecycleNode.on_shutdown`.
        """

        def end() -> None:
            self._stop()
            self._release_all()

        return self._run("shut down", end)

    on_error = on_cleanup  # after an error of the program

    def _asked(self, change: Callable[[Any, Any], Any], request: Any, response: Any) -> Any:
        """Answer a transition that this state does not have: rclpy raises, and never answers."""
        known = {
            transition[0]: transition[1] for transition in self._state_machine.available_transitions
        }
        wanted = request.transition.label or request.transition.id
        if wanted in known or wanted in known.values():
            return change(request, response)
        expected = ", ".join(f"{label} ({number})" for number, label in known.items())
        self.get_logger().warning(
            f"{self.get_name()} is {self.state} and has no transition {shown(str(wanted))}; "
            f"expected one of {expected}"
        )
        response.success = False
        return response

    def _stop(self) -> None:
        if self.active:
            self.active = False
            self.deactivate()

    def _release_all(self) -> None:
        self.active = self._autostart_pending = False
        if self._is_configured:
            self._is_configured = False
            self.cleanup()
        if self._permanent is not None:
            self._permanent.restore()

    def _run(self, what: str, work: Callable[[], None]) -> TransitionCallbackReturn:
        """Run one transition; rclpy would swallow its errors without a word."""
        try:
            work()
        except Exception as error:
            self._error = error
            expected = isinstance(error, RobotEnergyError)
            if not self._starting:
                text = str(error) if expected else "".join(traceback.format_exception(error))
                self.get_logger().error(f"{self.get_name()} cannot be {what}: {text}")
            return REFUSED if expected else BROKEN
        self.get_logger().info(what)
        return DONE


def _name(callback: Any) -> str:
    return str(getattr(callback, "__qualname__", type(callback).__name__))
