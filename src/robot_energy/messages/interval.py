"""Energy intervals -> fields of ``ros2_energy_msgs/EnergyInterval``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from robot_energy.accounting.account_record import deviation_of
from robot_energy.accounting.band_calibration import BandCalibration
from robot_energy.accounting.exact_sum import PER_JOULE
from robot_energy.accounting.record import EnergyInterval
from robot_energy.blocks import NANOSECOND
from robot_energy.messages.registers import (
    JOINT_FIELDS,
    SHAFT_FIELDS,
    load_fields,
    outlet_fields,
)


def interval_fields(
    interval: EnergyInterval, joint_names: Sequence[str], calibration: BandCalibration
) -> dict[str, Any]:
    """Return the plain fields of the message; ``start_ns`` and ``end_ns`` stay integers.

    Args:
        interval: What was counted.
        joint_names: Joints in model order.
        calibration: Of the bands of the account.

    Returns:
        Fields by name; ``joints`` is a list of the fields of `JointEnergy`, ``auxiliary`` one of
        those of `LoadEnergy`.
    """
    counted, nan = interval.counted, math.nan
    cabinet = {name: value / PER_JOULE for name, value in counted.cabinet_energy_microjoule.items()}
    observed, compared = counted.observed_ns * NANOSECOND, counted.compared_ns * NANOSECOND
    span_ns = counted.observed_ns + counted.gap_ns
    measured = counted.measured_energy_microjoule / PER_JOULE if compared else nan
    predicted = counted.predicted_energy_at_meter_microjoule / PER_JOULE if compared else nan
    peak = interval.peak_power_watt
    net = cabinet["grid_import"] - cabinet["grid_return"]
    sure = calibration.energy_band(deviation_of(counted))
    return {
        "id": interval.interval_id,
        "name": interval.name,
        "is_open": interval.is_open,
        "start_ns": interval.start_ns,
        "end_ns": interval.end_ns,
        "predicted_import_energy": cabinet["grid_import"],
        "predicted_return_energy": cabinet["grid_return"],
        "predicted_energy_std": sure.std,
        "predicted_energy_band": sure.half,
        "band": int(sure.kind),
        "brake_energy": cabinet["brake"],
        "measured_energy": measured,
        "predicted_energy_at_meter": predicted,
        "comparison_time": compared,
        "observed_time": observed,
        "gap_time": counted.gap_ns * NANOSECOND,
        "gap_count": counted.gap_count,
        "coverage": counted.observed_ns / span_ns if span_ns else nan,
        "predicted_peak_power": nan if peak is None else peak,
        "predicted_mean_power": net / observed if observed else nan,
        "measured_mean_power": measured / compared if compared else nan,
        **outlet_fields(counted),
        "auxiliary": load_fields(counted),
        "joints": [
            {
                "name": name,
                **{
                    field: counted.joint_energy_microjoule[register][index] / PER_JOULE
                    for register, field in JOINT_FIELDS.items()
                },
                **{
                    field: counted.joint_energy_microjoule[f"shaft_{register}"][index] / PER_JOULE
                    if counted.shaft_compared_ns[index]
                    else nan
                    for register, field in SHAFT_FIELDS.items()
                },
                "shaft_compared_time": counted.shaft_compared_ns[index] * NANOSECOND,
            }
            for index, name in enumerate(joint_names)
        ],
    }
