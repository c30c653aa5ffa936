"""The memory that a process says it has held."""

import subprocess
import sys

from robot_energy.foundation.process_memory import peak_memory

OWN = "from robot_energy.foundation.process_memory import peak_memory; print(peak_memory())"


def test_a_process_does_not_count_what_the_one_held_that_started_it():
    held = bytearray(400_000_000)
    for page in range(0, len(held), 4096):
        held[page] = 1
    done = subprocess.run([sys.executable, "-c", OWN], capture_output=True, text=True, check=True)
    assert peak_memory() > 400_000_000
    assert 1_000_000 < int(done.stdout) < 100_000_000
