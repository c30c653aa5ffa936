"""A replay as plain values: every figure that tables, JSON and figures show.

Energies in J, powers in W, times in s; integer times in ns end in ``_ns``, temperatures in
``_degc``. What was not measured is None, never 0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from robot_energy import __version__
from robot_energy.accounting.account import EnergyAccount
from robot_energy.accounting.exact_sum import PER_JOULE
from robot_energy.accounting.registers import CABINET_REGISTERS, JOINT_REGISTERS, Registers
from robot_energy.bag_replay import Replay
from robot_energy.blocks import NANOSECOND, MeterLocation, Phase, Quality
from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy.report.model_summary import count_tags
from robot_energy.report.payload_summary import payload_summary
from robot_energy.report.shaft_summary import shaft_summary

SUMMARY_VERSION = 1
BALANCE_RELATIVE = 1e-9
JOINT_KEYS = {
    "shaft_positive": "shaft_energy_positive",
    "shaft_negative": "shaft_energy_negative",
    "rigid": "rigid_energy",
    "friction": "friction_energy",
    "drive_loss": "drive_loss_energy",
}


def summarise(result: Replay, settings_note: str | None = None) -> dict[str, Any]:
    """Return all figures of a replay.

    Args:
        result: A finished replay.
        settings_note: What was changed about the model, for example fixed friction.

    Returns:
        Plain values that JSON can hold; NaN became None.
    """
    energy = breakdown(result.ledger.registers)
    summary = {
        "summary_version": SUMMARY_VERSION,
        "tool_version": __version__,
        "bag": str(result.bag),
        "origin": result.origin or None,
        "model": _model(result, settings_note),
        "topics": {
            "joint_states": list(result.topics.joint_states or ()),
            "temperatures": list(result.topics.temperatures or ()),
            "meter": result.topics.meter,
        },
        "time": _time(result),
        "comparison": _comparison(result),
        "energy": energy,
        "power": peak_and_mean(result.ledger),
        "phases": phases(result.ledger),
        "joints": _joints(result, energy["grid_import"] - energy["grid_return"]),
        **shaft_summary(result),
        **payload_summary(result),
        "inputs": _inputs(result),
        "quality": {
            "samples": result.ledger.samples,
            "counts": {
                str(Quality(bit).name).lower(): result.ledger.quality[bit]
                for bit in sorted(result.ledger.quality)
            },
        },
        "problems": _problems(result, energy),
        "notes": _notes(result),
    }
    return plain(summary)


def _model(result: Replay, note: str | None) -> dict[str, Any]:
    model = result.model
    return {
        "model_id": model.model_id,
        "source": model.source,
        "robot": model.robot.type,
        "serial": model.robot.serial or None,
        "drive": model.drive,
        "fallback_temperature_degc": model.temperature.fallback_degc,
        "figures": count_tags(model),
        "change": note,
        "notes": model.provenance.notes or None,
    }


def _time(result: Replay) -> dict[str, Any]:
    time = result.ledger.registers.time
    return {
        "start_ns": time.start_ns,
        "end_ns": time.end_ns,
        "span_ns": time.span_ns,
        "observed_ns": time.observed_ns,
        "gap_ns": time.gap_ns,
        "gap_count": time.gap_count,
        "backward_jumps": time.jumps,
        "coverage": time.coverage,
        "observed_time": time.observed_ns * NANOSECOND,
    }


def _comparison(result: Replay) -> dict[str, Any]:
    """Predicted beside measured, over the same intervals; None where nothing was measured."""
    comparison = result.ledger.comparison
    observed_ns = result.ledger.registers.time.observed_ns
    compared = comparison.compared_ns > 0
    seconds = comparison.compared_ns * NANOSECOND
    predicted = comparison.predicted_energy if compared else math.nan
    measured = comparison.measured_energy if compared else math.nan
    known = comparison.location is not MeterLocation.UNKNOWN
    constant = _constant_power(result)
    beyond = measured - constant * seconds
    return {
        "meter_location": comparison.location.name.lower() if known else None,
        "compared_ns": comparison.compared_ns,
        "compared_time": seconds,
        "coverage": comparison.compared_ns / observed_ns if observed_ns else math.nan,
        "predicted_energy_at_meter": predicted,
        "measured_energy": measured,
        "predicted_minus_measured_energy": predicted - measured,
        "predicted_minus_measured_relative": (
            (predicted - measured) / abs(measured) if compared and measured else math.nan
        ),
        "predicted_mean_power_at_meter": predicted / seconds if compared else math.nan,
        "measured_mean_power": measured / seconds if compared else math.nan,
        "constant_power_at_meter": constant,
        "predicted_energy_beyond_constant": predicted - constant * seconds,
        "measured_energy_beyond_constant": beyond,
        "beyond_constant_relative": (
            (predicted - measured) / abs(beyond) if compared and beyond else math.nan
        ),
    }


def _constant_power(result: Replay) -> float:
    """Losses of the model that flow through the meter whether the robot moves or not. [W]

    They can hide how well motion is predicted: a figure of the model file meets the
    standstill of the robot, and the longer it stands the smaller the relative error.
    """
    model, cabinet = result.model, result.model.cabinet
    kind = DRIVE_MODELS[model.drive]
    drives = [kind.constant_loss(entry) for entry in kind.entries(model.joints)]
    constant = cabinet.loss_dc.value + math.fsum(drives)
    at_grid = result.ledger.comparison.location is not MeterLocation.DC_BUS
    return constant + (cabinet.loss_grid.value if at_grid else 0.0)


def breakdown(registers: Registers) -> dict[str, Any]:
    """Return where the energy went, and whether the parts sum to what the grid gave. [J]

    Args:
        registers: Energy registers of one robot.
    """
    cabinet = {name: registers.cabinet(name) for name in CABINET_REGISTERS}
    joints = {
        name: math.fsum(registers.joints(name).tolist())
        for name in ("rigid", "friction", "drive_loss")
    }
    losses = ("loss_dc", "loss_grid", "brake", "capacitor")
    parts = (*joints.values(), *(cabinet[name] for name in losses))
    total = math.fsum(parts)
    net = cabinet["grid_import"] - cabinet["grid_return"]
    rounding = (len(CABINET_REGISTERS) + len(JOINT_REGISTERS) * registers.n_joints) / PER_JOULE
    turnover = math.fsum(abs(part) for part in parts)
    return {
        **cabinet,
        **joints,
        "sum_of_parts": total,
        "balance_residual": net - total,
        "balanced": abs(net - total) <= rounding + BALANCE_RELATIVE * turnover,
    }


def peak_and_mean(ledger: EnergyAccount) -> dict[str, Any]:
    """Return the highest and the mean predicted power at the grid. [W]

    Args:
        ledger: The books of one robot.
    """
    registers = ledger.registers
    seconds = registers.time.observed_ns * NANOSECOND
    net = registers.cabinet("grid_import") - registers.cabinet("grid_return")
    return {
        "predicted_peak_grid_power": ledger.peak_power,
        "predicted_mean_grid_power": net / seconds if seconds else math.nan,
    }


def phases(ledger: EnergyAccount) -> dict[str, Any]:
    """Return time [s] and energy [J] of each phase.

    Args:
        ledger: The books of one robot.
    """
    return {
        phase.name.lower(): {
            "time": ledger.phase_time(phase),
            "grid_import_energy": ledger.phase_energy(phase),
        }
        for phase in Phase
    }


def _joints(result: Replay, net: float) -> list[dict[str, Any]]:
    temperature = result.pipeline.friction.latest().motor_temperature_degc[0].tolist()
    rows = joint_energies(result.ledger.registers, result.model.joint_names, net)
    return [
        {**row, "last_motor_temperature_degc": degc}
        for row, degc in zip(rows, temperature, strict=True)
    ]


def joint_energies(
    registers: Registers, joint_names: Sequence[str], net: float
) -> list[dict[str, Any]]:
    """Return where each joint's energy went. [J]

    Args:
        registers: Energy registers of one robot.
        joint_names: In their order.
        net: Energy from the grid less what was returned, for the shares. [J]
    """
    columns = {key: registers.joints(name).tolist() for name, key in JOINT_KEYS.items()}
    rows: list[dict[str, Any]] = []
    for index, name in enumerate(joint_names):
        row = {key: values[index] for key, values in columns.items()}
        drawn = row["rigid_energy"] + row["friction_energy"] + row["drive_loss_energy"]
        rows.append(
            {
                "name": name,
                **row,
                "drive_input_energy": drawn,
                "share_of_grid": drawn / net if net > 0 else math.nan,
            }
        )
    return rows


def _inputs(result: Replay) -> dict[str, Any]:
    """Account of every input: received = accepted + sum of rejected by reason."""
    accounts = {
        "joint_state_messages": result.joint_states.account,
        "temperature_messages": result.temperatures.account,
        "temperature_values": result.pipeline.friction.account,
        "meter_messages": result.meter.account,
        "meter_readings": result.ledger.comparison.curve.account,
    }
    if result.topics.payload:
        accounts["payload_messages"] = result.payload.account
    table: dict[str, Any] = {}
    for name, account in accounts.items():
        rejected = {reason: count for reason, count in sorted(account.rejected.items()) if count}
        table[name] = {
            "received": account.received,
            "accepted": account.accepted,
            "rejected": rejected,
            "balanced": account.received == account.accepted + sum(rejected.values()),
        }
    return table


def _problems(result: Replay, energy: dict[str, Any]) -> list[str]:
    problems = list(result.problems)
    if not energy["balanced"]:
        problems.append(
            "the parts of the energy do not sum to the grid: "
            f"{energy['balance_residual']:g} J are left"
        )
    for name, account in _inputs(result).items():
        if not account["balanced"]:
            problems.append(f"the account of {name.replace('_', ' ')} does not balance")
    return problems


def _notes(result: Replay) -> list[str]:
    """What a reader should know before trusting the figures."""
    notes: list[str] = list(result.notes)
    ledger, topics = result.ledger, result.topics
    if not topics.meter:
        notes.append("the bag has no power meter: nothing was measured")
    elif not ledger.comparison.compared_ns:
        notes.append("no reading of the power meter covers any of the predicted time")
    notes += ledger.judgement.findings(ledger.comparison)
    counter = ledger.comparison.curve.counter
    if counter.resets:
        notes.append(
            f"the counter of the meter was reset {counter.resets} times, last at stamp "
            f"{(counter.reset_ns or 0) * NANOSECOND:.3f}; nothing counts across a reset"
        )
    if not topics.temperatures:
        notes.append(
            "no motor temperatures: friction at the model's fallback of "
            f"{result.model.temperature.fallback_degc:g} degC"
        )
    elif fallback := result.pipeline.power.fallback_use.sentence:
        notes.append(fallback)
    if result.payload.refused:
        notes.append(f"a payload of the bag was refused: {result.payload.refused}")
    ignored = result.joint_states.ignored_joints
    if ignored:
        notes.append(f"joints that the model does not know: {', '.join(sorted(ignored))}")
    foreign = result.temperatures.ignored_joints - ignored
    if foreign:
        notes.append(f"temperatures of what is no joint of the model: {', '.join(sorted(foreign))}")
    notes += [finding.sentence for finding in result.joint_states.findings()]
    jumps = ledger.registers.time.jumps
    if jumps:
        notes.append(f"stamps jumped back {jumps} times; no energy counts across a jump")
    return notes


def plain(value: Any) -> Any:
    """Replace NaN and infinities by None, which JSON can hold."""
    if isinstance(value, dict):
        return {str(key): plain(entry) for key, entry in value.items()}  # pyright: ignore
    if isinstance(value, list):
        return [plain(entry) for entry in value]  # pyright: ignore
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
