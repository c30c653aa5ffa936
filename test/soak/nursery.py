"""Gives birth to energy monitors within a quarter of a second: everything is imported once.

A process of its own, driven over its pipes: for each line of arguments it forks, and the
child runs the real ``main`` of the node; the number of the child comes back. When its
input ends, it kills what still runs and ends.
"""

from __future__ import annotations

import os
import signal
import sys

from ros2_energy_monitor.nodes.energy_monitor import main


def serve() -> None:
    """Fork for every line of input."""
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # the dead are not kept
    child = 0
    print("ready", flush=True)
    for line in sys.stdin:
        child = os.fork()
        if child == 0:
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            os._exit(main(line.split()))
        print(child, flush=True)
    if child:
        try:
            os.kill(child, signal.SIGKILL)
        except ProcessLookupError:
            pass


if __name__ == "__main__":
    serve()
