# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The shared main of the nodes: start, spin, stop cleanly, report errors in one sentence."""

from __future__ import annotations

import faulthandler
import inspect
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Any, Protocol

import rclpy
from rclpy.context import Context
from rclpy.exceptions import InvalidHandle
from rclpy.executors import (
    ExternalShutdownException,
    SingleThreadedExecutor,
    TimeoutException,
)
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy
from rclpy.service import Service
from rclpy.signals import SignalHandlerOptions

from robot_energy.foundation.errors import RobotEnergyError
from robot_energy.foundation.kinds import load_kinds
from ros2_energy_monitor.base.guard import Guard
from ros2_energy_monitor.base.shared_memory import clear_ports

EXIT_BAD_SETUP = 2
PATIENCE = 0.1  # longest wait; then it is asked whether to stop [s]
RARELY = 0.2  # between two looks at services and events [s]
EXPECTED = {  # where ROS says only what its parser met
    "params file": "expected YAML with /** or the name of a node, below it ros__parameters, and "
    "below that the parameters, with spaces and no tabs",
    "parameter override rule": "expected -p NAME:=VALUE",
}
MAX_END = 20.0  # after this the process ends, and says where the middleware hangs [s]


class Closable(Protocol):
    """A node that hands out what still waits when it is stopped."""

    def close(self) -> None:
        """Publish what still waits."""
        ...


STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class StopSignal:
    """Notes `STOP_SIGNALS`; any number of them asks for one clean stop.

    A signal that is ignored already stays so: ``nohup`` ignores SIGHUP.
    """

    def __init__(self) -> None:
        self.received = False
        for number in STOP_SIGNALS:
            if number == signal.SIGINT or signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, self._note)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.received = True

    def ignore(self) -> None:
        """Ignore further signals, also while the interpreter ends."""
        for number in STOP_SIGNALS:
            signal.signal(number, signal.SIG_IGN)


@contextmanager
def ros(args: Sequence[str] | None = None) -> Iterator[Context]:
    """Yield the context of nodes, ended with the block; signals stay with Python.

    Args:
        args: Command line; None for that of the process.
    """
    context = Context()
    rclpy.init(
        args=None if args is None else list(args),
        context=context,
        signal_handler_options=SignalHandlerOptions.NO,
    )
    try:
        yield context
    finally:
        context.try_shutdown()


class TickExecutor(SingleThreadedExecutor):
    """Sleeps until the next timer; looks at services and events five times a second.

    rclpy makes two wait sets for every callback. At 25 ticks a second that costs as much as the
    work of a small node. Where a topic that is not latched has callbacks, it waits as rclpy
    does: an `Inbox` has none.
    """

    def __init__(self, context: Context) -> None:
        super().__init__(context=context)
        self._due = 0.0  # when to look at all next [s]
        self._called_back = False  # whether messages come at any time

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Wait for what is ready, and execute it.

        Args:
            timeout_sec: Longest wait; None for no limit but that of the next look at all. [s]
        """
        now = time.monotonic()
        if now >= self._due:
            self._due = now + RARELY
            subscriptions = [each for node in self.get_nodes() for each in node.subscriptions]
            self._called_back = any(map(self._calls_back, subscriptions))
            self._execute_all()
        elif self._called_back:
            super().spin_once(timeout_sec)
        else:
            rest = self._due - now
            self._execute_timers(rest if timeout_sec is None else min(rest, timeout_sec))

    def _calls_back(self, subscription: Any) -> bool:
        """Whether messages come at any time: topics that are latched are rare."""
        latched = subscription.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        return not latched and self.can_execute(subscription)

    def _execute_all(self) -> None:
        """Execute all that is ready now: of a service one request after the other, for 0.2 s.

        With a wait of zero rclpy gives one request of each service and ends.
        """
        answered = True
        while answered and time.monotonic() < self._due:
            answered = False
            try:
                while True:
                    handler, entity, _ = self.wait_for_ready_callbacks(0.0)
                    handler()
                    error = handler.exception()
                    if error is not None:
                        raise error
                    answered |= isinstance(entity, Service)
            except TimeoutException:
                continue

    def _execute_timers(self, timeout: float) -> None:
        """Sleep until the next timer and execute those that are ready."""
        timers = [timer for node in self.get_nodes() for timer in node.timers]
        left = [timer.time_until_next_call() for timer in timers if not timer.is_canceled()]
        time.sleep(max(0.0, min([timeout, *(each * 1e-9 for each in left if each is not None)])))
        for timer in timers:
            try:
                if not timer.is_ready():
                    continue
                with timer.handle:
                    timer.handle.call_timer()
            except InvalidHandle:  # destroyed by another timer
                continue
            timer.callback()


def spin(node: Node, context: Context, stopped: Callable[[], bool]) -> None:
    """Execute a node until it is stopped or its context is shut down.

    Args:
        stopped: Asked after every callback, at least every 0.1 s.
    """
    executor = TickExecutor(context)
    executor.add_node(node)
    guard: Guard | None = getattr(node, "guard", None)
    try:
        while context.ok() and not stopped():
            try:
                executor.spin_once(timeout_sec=PATIENCE)
            except (ExternalShutdownException, InvalidHandle):
                raise
            except Exception as error:  # of rclpy itself: callbacks are guarded on their own
                if guard is None:
                    raise
                guard.note("executor", error)
    except (ExternalShutdownException, InvalidHandle):
        if context.ok():
            raise
    finally:
        executor.shutdown(timeout_sec=1.0)


def run(make_node: Callable[..., Node], args: Sequence[str] | None = None) -> int:
    """Run one node as a process.

    Args:
        make_node: Constructor of the node; called with its ``context``.
        args: Command line; None for that of the process. ``--help`` prints the usage and
            starts nothing.

    Returns:
        Exit code: 0 after the usage, SIGINT, SIGTERM, a shutdown from outside or that of a
        managed node; 2 if the node could not be set up, after one sentence in the log. The
        process ends with 1, and the stack of every thread, if the middleware does not let it end
        within 20 s; what had to be written is written by then.
    """
    name = getattr(make_node, "NAME", "robot_energy")
    if {"-h", "--help"}.intersection(sys.argv[1:] if args is None else args):
        print(usage(name, inspect.getdoc(make_node) or ""))
        return 0
    stop = StopSignal()
    try:
        with ros(args) as context:
            load_kinds()
            for sentence in clear_ports():
                get_logger(name).warning(sentence)
            node = make_node(context=context)
            try:
                spin(node, context, lambda: stop.received or getattr(node, "finalized", False))
                if context.ok():
                    _close(node)
            finally:
                stop.ignore()
                faulthandler.dump_traceback_later(MAX_END, exit=True)
                node.destroy_node()
    except RobotEnergyError as error:
        get_logger(name).fatal(str(error))
        return EXIT_BAD_SETUP
    except (rclpy_implementation.UnknownROSArgsError, rclpy_implementation.RCLError) as error:
        found = str(error).splitlines()[0]
        expected = [text for words, text in EXPECTED.items() if words in found]
        get_logger(name).fatal("; ".join([f"ROS could not be started: {found}", *expected]))
        return EXIT_BAD_SETUP
    except KeyboardInterrupt:  # a signal before the handlers were in place
        return 0
    finally:
        stop.ignore()
        faulthandler.cancel_dump_traceback_later()
    return 0


def usage(name: str, description: str) -> str:
    """Return the help of an executable: what it does, how to start it, where its parameters are."""
    installed = os.sep in sys.argv[0]  # the script that `ros2 run` starts; else a bare name
    start = f"{'ros2 run' if installed else 'python -m'} ros2_energy_monitor {name}"
    return (
        f"{' '.join(description.partition('Args:')[0].split())}\n\n"
        f"usage: {start} --ros-args [--params-file FILE] [-p NAME:=VALUE] [-r FROM:=TO]\n\n"
        f"All parameters with their meaning: config/{name}.yaml of the package, or\n"
        f"ros2 param describe /{name} NAME"
    )


def _close(node: Node | Closable) -> None:
    close = getattr(node, "close", None)
    if callable(close):
        close()
