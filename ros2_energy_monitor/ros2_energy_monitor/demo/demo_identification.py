# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""First part of the demonstration: the model of a plant nobody has figures of."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from rich.console import Console

from robot_energy.foundation.errors import BagError

PLANT_SEED = 1  # the first one; figures of the plant were not looked at
BAGS = ("drawn_train_cold", "drawn_train_middle", "drawn_train_warm")
START = "kr16"  # bodies and gears, and first figures of everything else
FILE = "identified.yaml"


def bundled(bags: Path, names: Iterable[str]) -> list[Path]:
    """Return bags of the repository."""
    paths = [bags / name for name in names]
    for path in paths:
        if not path.exists():
            raise BagError(
                f"the bag {path.name} is not in {bags.resolve()}",
                "the bags of the repository",
                "start the demonstration at the top of the repository or name --bags",
            )
    return paths


def identify_plant(bags: Path, out: Path) -> str:
    """Return the model file of the plant, identified from its training bags."""
    # Slow to import, and of no use to the live part.
    from robot_energy_identify.api.identify import identify_all
    from robot_energy_report.document import Document
    from robot_energy_report.identify_all import identification_overview
    from robot_energy_report.printing import print_document

    paths, file = bundled(bags, BAGS), out / FILE
    out.mkdir(parents=True, exist_ok=True)
    command = f"robot-energy identify all {' '.join(map(str, paths))} --model {START}"
    print(f"Identify: {command} --effort motor_torque --no-test --out {file}", flush=True)
    result = identify_all(paths, START, "motor_torque", held_out=False)
    page = Document()
    identification_overview(result.found, page)
    print_document(page, Console())
    result.save(file)
    return str(file)
