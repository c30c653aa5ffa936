# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The status of the loads outside of the cabinet."""

from __future__ import annotations

import math

import numpy as np

from robot_energy.accounting.account import EnergyAccount
from robot_energy.accounting.load_curve import COLUMNS, UNKNOWN, LoadCurve, Remark
from ros2_energy_monitor.base.auxiliary_loads import AuxiliaryLoads, LoadInput
from ros2_energy_monitor.diagnostics.inputs import accounting, counted
from ros2_energy_monitor.diagnostics.reporter import STALE, WARN, Source, StatusBuilder


def auxiliary_sources(account: EnergyAccount, loads: AuxiliaryLoads) -> list[Source]:
    """Return what makes the status of the loads; nothing where the model has none."""
    counted = account.auxiliary
    if counted is None:
        return []

    def findings() -> StatusBuilder:
        found = StatusBuilder("auxiliary loads")
        totals, now = account.totals(), account.end_ns
        stamps = np.array([] if now is None else [now], dtype=np.int64)
        shown = counted.shown(stamps)
        found.values["outlet_energy_j"] = totals.outlet_energy_microjoule * 1e-6
        found.values["outlet_time_s"] = totals.outlet_ns * 1e-9
        for place, (curve, topics) in enumerate(zip(counted.curves, loads.loads, strict=True)):
            name, total = curve.load.name, totals.auxiliary[curve.load.name]
            row = dict(zip(COLUMNS, shown[0, place].tolist(), strict=True)) if len(stamps) else {}
            state = int(row.get("state", UNKNOWN))
            found.values |= {
                f"{name}.state": "unknown" if state == UNKNOWN else curve.load.state_names[state],
                f"{name}.power_w": row.get("power", math.nan),
                f"{name}.energy_j": total.energy_microjoule * 1e-6,
                f"{name}.known_time_s": total.known_ns * 1e-9,
                f"{name}.missing_time_s": total.missing_ns * 1e-9,
                f"{name}.missing_count": total.missing_count,
            }
            if topics.ingest.state is not None:
                found.values |= accounting(topics.ingest.state.rejections, f"{name}.state_")
                found.values[f"{name}.state_unknown_numbers"] = curve.bad_states
            if topics.ingest.meter is not None:
                found.values |= accounting(topics.ingest.meter.rejections, f"{name}.meter_")
                found.values |= accounting(curve.curve.rejections, f"{name}.meter_readings_")
                found.values[f"{name}.meter_age_s"] = row.get("measurement_age", math.nan)
            if row:
                _judge(found, curve, topics, Remark(int(row["remarks"])), row["measurement_age"])
        return found

    return [findings]


def _judge(
    found: StatusBuilder, curve: LoadCurve, topics: LoadInput, remarks: Remark, age: float
) -> None:
    """Say what is wrong with the power of a load."""
    name = curve.load.name
    if Remark.STATE_UNKNOWN in remarks:
        last = f"; {curve.bad_states} numbers were those of no state" if curve.bad_states else ""
        level, remedy = WARN, "publish its state, or set the key state in the model file"
        if curve.metered:  # the power is known all the same
            found.notes.append(f"the state of {name} is not known{last}")
        else:
            found.add(
                level, f"the state of {name} is not known: its power is missing{last}", remedy
            )
    elif Remark.STATE_ASSUMED in remarks:
        where = ", ".join(f"{one.topic}, which has {counted(one)}" for one in topics.states)
        found.notes.append(
            f"no state of {name} on {where or 'any topic'}: '{curve.load.initial}' of the model "
            "file is in force"
        )
    where = " and ".join(inbox.topic for inbox in topics.meters) or "any topic"
    if Remark.METER_REFUSED in remarks:
        found.add(WARN, f"the newest reading of the meter of {name} on {where} is refused")
    elif Remark.METER_MISSING in remarks:
        publishers = ", ".join(f"{one.topic} has {counted(one)}" for one in topics.meters)
        found.add(
            WARN,
            f"no reading of the meter of {name} has come ({publishers or where}): its power is "
            "missing",
            "start its driver, or set its topic in auxiliary_meters",
        )
    elif Remark.METER_STALE in remarks:
        found.add(STALE, f"no reading of the meter of {name} for {age:.1f} s on {where}")
