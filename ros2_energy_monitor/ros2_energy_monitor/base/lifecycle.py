"""The life cycle of a managed node: four steps to fill in, errors told in one sentence."""

from __future__ import annotations

import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from robot_energy.errors import RobotEnergyError
from ros2_energy_monitor.entities import Entities

DONE, REFUSED, BROKEN = (
    TransitionCallbackReturn.SUCCESS,
    TransitionCallbackReturn.FAILURE,
    TransitionCallbackReturn.ERROR,
)


class ManagedNode(LifecycleNode, ABC):
    """A node that is configured, activated, deactivated and cleaned up, any number of times.

    A subclass fills in `equip`, `begin`, `finish` and `release`, and ends its constructor
    with `settle`. What a step raises as `RobotEnergyError` refuses the transition and is
    logged in one sentence; any other error is logged whole and takes the node back to
    unconfigured.

    Args:
        name: Name of the node.
        options: Options of `rclpy.node.Node`.

    Attributes:
        active: Whether the node counts and publishes.
    """

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self.active = False
        self._equipped = False
        self._starting = False
        self._starts_late = False
        self._error: Exception | None = None
        self._kept: Entities | None = None

    @abstractmethod
    def equip(self) -> None:
        """Read files and create entities; called by configure."""

    @abstractmethod
    def begin(self) -> None:
        """Start to work; called by activate."""

    @abstractmethod
    def finish(self) -> None:
        """Hand out what still waits; called by deactivate."""

    @abstractmethod
    def release(self) -> None:
        """Let go of files; called by cleanup, also after an `equip` that failed halfway."""

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

    def settle(self, *, start: bool) -> None:
        """End the constructor; entities created before are kept by cleanup.

        Args:
            start: Whether to configure and activate now, or once it is `ready`.

        Raises:
            Exception: What keeps it from starting.
        """
        self._kept = Entities(self)
        if not start:
            return
        self._starting = True
        if self.trigger_configure() != DONE or (self.ready and self.trigger_activate() != DONE):
            raise self._error or RuntimeError(f"{self.get_name()} cannot be started")
        self._starting = False
        self._starts_late = not self.active

    def start_late(self) -> None:
        """Activate, now that what was awaited at the start is there."""
        if self._starts_late:
            self.trigger_activate()

    def close(self) -> None:
        """Become inactive, if active, so that nothing that waits is lost."""
        if self.active:
            self.trigger_deactivate()

    def destroy_node(self) -> None:
        """Destroy the node, its files released before."""
        self._let_go()
        super().destroy_node()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Equip the node; if that fails it stays unconfigured, with nothing left behind."""

        def equip() -> None:
            self._equipped = True
            self.equip()

        result = self._run("configured", equip)
        if result == REFUSED:
            self._let_go()
        return result

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start to work."""

        def begin() -> None:
            self.begin()
            self.active = True

        return self._run("activated", begin)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Hand out what waits and stop."""
        return self._run("deactivated", self._stop)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let go of everything; configure starts anew."""
        return self._run("cleaned up", self._let_go)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Hand out what waits and let go of everything for good."""

        def end() -> None:
            self._stop()
            self._let_go()

        return self._run("shut down", end)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let go of everything after an unexpected error."""
        return self._run("cleaned up", self._let_go)

    def _stop(self) -> None:
        if self.active:
            self.active = False
            self.finish()

    def _let_go(self) -> None:
        self.active = self._starts_late = False
        if self._equipped:
            self._equipped = False
            self.release()
        if self._kept is not None:
            self._kept.restore()

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
        return DONE
