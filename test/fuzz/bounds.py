"""Time and memory of a target on damaged samples: ``python test/fuzz/bounds.py TARGET COUNT``.

Coverage-guided fuzzing says little of either: instrumented code is slower, and atheris keeps
some 0.8 MB for every input. This runs the plain code, in a process of its own, and prints
processor time of the slowest input [s] and peak of memory [MB] as JSON.
"""

from __future__ import annotations

import json
import random
import resource
import sys
import time

from damage import KINDS, MAX_VALUE, damaged
from target import discard_scratch
from targets import TARGETS

MAX_EDITS = 8


def measured(name: str, count: int) -> dict[str, float | int | str]:
    """Run a target on its samples and on so many damaged ones."""
    target, draw = TARGETS[name], random.Random(name)
    seeds = target.seeds()
    target.run(seeds[0])  # what is made once is not a cost of an input
    slowest, culprit = 0.0, b""
    for number in range(len(seeds) + count):
        data = seeds[number % len(seeds)]
        if number >= len(seeds):
            edits = range(draw.randint(1, MAX_EDITS))
            data = damaged(
                data,
                [(draw.choice(KINDS), draw.random(), draw.randint(0, MAX_VALUE)) for _ in edits],
            )
        begin = time.process_time()
        target.run(data)
        spent = time.process_time() - begin
        if spent > slowest:
            slowest, culprit = spent, data
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {"inputs": count, "slowest": slowest, "peak": peak, "input": culprit[:1000].hex()}


if __name__ == "__main__":
    try:
        print(json.dumps(measured(sys.argv[1], int(sys.argv[2]))))
    finally:
        discard_scratch()
