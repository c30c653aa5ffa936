"""Electrical input of a three-phase drive from its currents and voltages in the rotor frame."""

from __future__ import annotations

from robot_energy.foundation.units import DQ_FACTORS, DqScaling
from robot_energy.timeline.blocks import Float


def electrical_power(
    current_d: Float,
    current_q: Float,
    voltage_d: Float,
    voltage_q: Float,
    scaling: DqScaling = "peak",
) -> Float:
    """Return the electrical power that a drive gives its motor. [W]

    ``P_el = k (i_q u_q + i_d u_d)``. With amplitudes that are phase peaks, as in paper B, ``k`` is
    3/2; with RMS values of a phase 3; with the power-invariant transformation 1. The losses of the
    inverter are not in it.

    Args:
        current_d: Along the flux of the rotor, any shape. [A]
        current_q: Across the flux, same shape. [A]
        voltage_d: Same shape. [V]
        voltage_q: Same shape. [V]
        scaling: What the amplitudes are: ``peak``, ``rms`` or ``power_invariant``.

    Returns:
        Same shape, positive into the motor; NaN where a value is NaN. Source: paper B eq. 1.
    """
    return DQ_FACTORS[scaling] * (current_q * voltage_q + current_d * voltage_d)
