"""The energy account and its intervals -> ``EnergyRegisters`` and ``EnergyInterval``."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robot_energy.accounting.account import EnergyAccount
from robot_energy.accounting.account_record import deviation_of
from robot_energy.accounting.exact_sum import PER_JOULE
from robot_energy.accounting.record import EnergyInterval
from robot_energy.accounting.registers import JOINT_REGISTERS, SHAFT_REGISTERS
from robot_energy.accounting.totals import Totals
from robot_energy.bag.cdr.decode import Encoder, stamp_columns
from robot_energy.certainty.band_calibration import BandCalibration
from robot_energy.foundation.units import MAX_COUNTER, SECOND_NS
from robot_energy.messages.fields import (
    ENERGY_REGISTERS,
    EXACT_FIELDS,
    EXACT_JOINT_FIELDS,
    FRAME,
    JOINT_FIELDS,
    RECORDING,
    SHAFT_FIELDS,
)
from robot_energy.model.auxiliary import AuxiliaryLoad
from robot_energy.timeline.blocks import known_part


class RegistersWriter:
    """Serialises registers as they stand; parts that the model lacks are NaN while they are 0."""

    def __init__(
        self,
        joint_names: Sequence[str],
        model_id: str,
        loads: Sequence[AuxiliaryLoad] = (),
        unmodelled: Collection[str] = (),
    ) -> None:
        self._unmodelled = unmodelled
        states = [(load.name, state) for load in loads for state in load.state_names]
        constants = {
            "model_id": model_id,
            "joints.name": tuple(joint_names),
            "auxiliary.name": tuple(load.name for load in loads),
            "auxiliary_states.load": tuple(load for load, _ in states),
            "auxiliary_states.state": tuple(state for _, state in states),
        }
        self._encoders = [
            Encoder(ENERGY_REGISTERS, {FRAME: frame, **constants}) for frame in ("", RECORDING)
        ]

    def encode(
        self,
        account: EnergyAccount,
        persisted: bool = False,
        minute_ns: int = 0,
        recording: bool = False,
        ended: bool = False,
    ) -> NDArray[np.uint8] | None:
        """Return one serialised message, shape (1, size); None before the first sample.

        Args:
            persisted: Whether they are on disk as they stand.
            minute_ns: UTC minute up to which all samples are counted; 0 for none. [ns]
            recording: Whether they count a recording that is played.
            ended: Whether nothing more comes: then both energies at the meter are as counted.
        """
        registers, comparison = account.registers, account.comparison
        time, start_ns, end_ns = registers.time, account.start_ns, account.end_ns
        if start_ns is None or end_ns is None:
            return None
        compared, sure = comparison.compared_ns > 0, account.energy_band
        at_meter = (
            comparison.predicted_energy if compared and ended else comparison.comparable_energy
        )
        return self._encoders[recording].encode(
            {
                **stamp_columns(np.array([end_ns])),
                **stamp_columns(np.array([start_ns]), "energy_start"),
                "persisted": persisted,
                "predicted_import_energy": registers.cabinet("grid_import"),
                "predicted_return_energy": registers.cabinet("grid_return"),
                "predicted_energy_std": sure.std,
                "predicted_energy_band": sure.half,
                "band": np.uint8(sure.kind),
                "measured_energy": comparison.measured_energy if compared else np.nan,
                "predicted_energy_at_meter": at_meter,
                "brake_energy": registers.cabinet("brake"),
                "loss_dc_energy": registers.cabinet("loss_dc"),
                "loss_grid_energy": registers.cabinet("loss_grid"),
                "capacitor_energy": known_part(
                    "capacitor", registers.cabinet("capacitor"), self._unmodelled
                ),
                "observed_time": time.observed_ns / SECOND_NS,
                "gap_time": time.gap_ns / SECOND_NS,
                "comparison_time": comparison.compared_ns / SECOND_NS,
                "predicted_energy_learned": float(account.counts.learned_energy_sum.joule[0]),
                "gap_count": np.uint64(time.gap_count),
                **{
                    f"joints.{JOINT_FIELDS[name]}": known_part(
                        name, registers.joints(name), self._unmodelled
                    )[None, :]
                    for name in JOINT_REGISTERS
                },
                **{
                    f"joints.{SHAFT_FIELDS[name]}": account.shaft.joints(name)[None, :]
                    for name in SHAFT_REGISTERS
                },
                "joints.shaft_compared_time": account.shaft.compared_ns[None, :] / SECOND_NS,
                **stamp_columns(np.array([minute_ns]), "minute"),
                **exact_columns(account),
                **_load_columns(account),
            },
            1,
        )


def load_fields(counted: Totals) -> list[dict[str, Any]]:
    """Return the fields of ``LoadEnergy`` of every auxiliary load, in order."""
    return [
        {
            "name": name,
            "energy": load.energy_microjoule / PER_JOULE,
            "known_time": load.known_ns / SECOND_NS,
            "missing_time": load.missing_ns / SECOND_NS,
            "missing_count": load.missing_count,
            "outlet_energy": load.outlet_energy_microjoule / PER_JOULE,
        }
        for name, load in counted.auxiliary.items()
    ]


def outlet_fields(counted: Totals) -> dict[str, float]:
    """Return the fields of the outlet; NaN where no auxiliary loads are counted."""
    unit = PER_JOULE if counted.auxiliary else np.nan
    return {
        "outlet_energy": counted.outlet_energy_microjoule / unit,
        "outlet_cabinet_energy": counted.outlet_cabinet_energy_microjoule / unit,
        "outlet_time": counted.outlet_ns / SECOND_NS,
    }


def interval_fields(
    interval: EnergyInterval,
    joint_names: Sequence[str],
    calibration: BandCalibration,
    unmodelled: Collection[str] = (),
) -> dict[str, Any]:
    """Return the plain fields of the message, its joints and its loads; stamps stay integers."""
    counted, nan = interval.counted, math.nan
    cabinet = {name: value / PER_JOULE for name, value in counted.cabinet_energy_microjoule.items()}
    observed, compared = counted.observed_ns / SECOND_NS, counted.compared_ns / SECOND_NS
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
        "gap_time": counted.gap_ns / SECOND_NS,
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
                    field: float(
                        known_part(
                            register,
                            counted.joint_energy_microjoule[register][index] / PER_JOULE,
                            unmodelled,
                        )
                    )
                    for register, field in JOINT_FIELDS.items()
                },
                **{
                    field: counted.joint_energy_microjoule[f"shaft_{register}"][index] / PER_JOULE
                    if counted.shaft_compared_ns[index]
                    else nan
                    for register, field in SHAFT_FIELDS.items()
                },
                **{
                    field: counted.joint_energy_microjoule[register][index]
                    for register, field in EXACT_JOINT_FIELDS.items()
                },
                "shaft_compared_time": counted.shaft_compared_ns[index] / SECOND_NS,
            }
            for index, name in enumerate(joint_names)
        ],
    }


def exact_columns(account: EnergyAccount) -> dict[str, Any]:
    """Return the exact fields of ``EnergyRegisters``; of joints and phases shape (1, K)."""
    registers, comparison, counts = account.registers, account.comparison, account.counts
    cabinet = registers.microjoule[: len(EXACT_FIELDS)].tolist()
    joints = registers.microjoule[len(EXACT_FIELDS) : registers.deviations.start]
    by_name = joints.reshape(len(JOINT_REGISTERS), -1)
    measured, at_meter = comparison.microjoule.tolist()
    return {
        **dict(zip(EXACT_FIELDS.values(), cabinet, strict=True)),
        "measured_microjoule": measured,
        "predicted_microjoule_at_meter": at_meter,
        "observed_ns": registers.time.observed_ns,
        "gap_ns": registers.time.gap_ns,
        "compared_ns": min(comparison.compared_ns, MAX_COUNTER),
        "phase_microjoule": counts.phase_energy_sum.microjoule[None, :],
        "phase_ns": counts.phase_ns[None, :],
        "standby_microjoule": int(counts.standby.energy.microjoule[0]),
        "standby_ns": counts.standby.ns,
        "meter_location": np.uint8(comparison.location),
        **{
            f"joints.{field}": row[None, :]
            for field, row in zip(EXACT_JOINT_FIELDS.values(), by_name, strict=True)
        },
    }


def _load_columns(account: EnergyAccount) -> dict[str, Any]:
    totals, loads = account.totals(), account.auxiliary
    rows = load_fields(totals)
    kinds = {"missing_count": np.uint64}
    states = (loads.state_energy.joule, loads.state_ns / SECOND_NS) if loads else np.empty((2, 0))
    return {
        **outlet_fields(totals),
        **{
            f"auxiliary.{name}": np.array([[row[name] for row in rows]], kinds.get(name, float))
            for name in ("energy", "known_time", "missing_time", "missing_count", "outlet_energy")
        },
        "auxiliary_states.energy": states[0][None, :],
        "auxiliary_states.time": states[1][None, :],
    }
