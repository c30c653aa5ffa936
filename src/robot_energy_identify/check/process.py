"""The checks as a process of their own, of low priority, for a monitor that goes on meanwhile.

``python -m robot_energy_identify.check.process NICENESS`` reads what a monitor saw from its
standard input, as pickled keyword arguments of `robot_energy_identify.check.evidence.evidence_of`,
and writes the findings as JSON, without the options of the command. Only a parent process on the
same machine feeds it.
"""

from __future__ import annotations

import json
import os
import pickle
import sys
from dataclasses import asdict

from robot_energy_identify.check.evidence import Remarks, evidence_of
from robot_energy_identify.check.finding import OF_THE_COMMAND
from robot_energy_identify.check.run import checks_of


def main() -> None:
    """Check what comes on standard input."""
    if hasattr(os, "nice"):
        os.nice(int(sys.argv[1]))
    seen = pickle.load(sys.stdin.buffer)
    remarks = Remarks(**seen.pop("remarks"))
    result = checks_of(evidence_of(**seen, remarks=remarks)).result("", seen["model"])
    found = {
        "findings": [asdict(one) for one in result.findings],
        "checked": result.checked,
        "skipped": result.skipped,
    }
    sys.stdout.write(OF_THE_COMMAND.sub("", json.dumps(found)))


if __name__ == "__main__":
    main()
