"""Plants of the printing machines of paper B: planar arm, gantry, articulated arm.

As in `rig.profile`: bodies, gear ratios and rotor inertias of the shipped models, and nothing
else of them. No figure was measured. Friction and losses have terms that the models do not have
(Stribeck, load, lubricant, iron, inverter), and where they share a term another figure.
"""

from __future__ import annotations

import numpy as np

from robot_energy.blocks import Float
from robot_energy.rig.lubricant import VG220_SYNTHETIC, Lubricant
from robot_energy.rig.profile import PlantProfile, SupplyProfile, calibrated_viscous

GREASE = Lubricant(180.0, 17.0)  # base oil of a harmonic gear's grease, catalogue level
SUPPLY = SupplyProfile(
    loss_dc=45.0,
    loss_grid=70.0,
    rectifier_efficiency=0.985,
    capacitance=1.0e-3,
    rectified_voltage=566.0,
    chopper_on_voltage=700.0,
    chopper_off_voltage=680.0,
    brake_resistance=50.0,
)


def mantis_profile() -> PlantProfile:
    """Return a plant of the Printing Mantis class.

    Paper B measures 30 to 50 % efficiency of the drives, shaft over electrical input, while a
    wall is printed at 125 mm/s (motor speeds of 60 to 200 rpm); winding resistances were chosen
    so that this plant does the same. Its friction was not chosen by any result.
    """
    class_coulomb = np.array([0.35, 0.28, 0.22])
    cold = np.array([2.0, 1.6, 1.4]) * 1e-3
    hot = 0.4 * cold
    return PlantProfile(
        body="mantis",
        lubricant=(GREASE,) * 3,
        coulomb=0.85 * class_coulomb,
        load_coulomb=np.full(3, 0.06),
        stribeck=0.15 * class_coulomb,
        stribeck_velocity=np.full(3, 10.0),
        viscous_40=_viscous((GREASE,) * 3, cold, hot),
        torque_constant=np.array([0.60, 0.55, 0.50]),
        torque_constant_fall=np.full(3, 0.0011),
        resistance=np.array([2.0, 2.2, 2.6]),
        resistance_rise=np.full(3, 0.0039),
        hysteresis_torque=np.array([0.03, 0.025, 0.02]),
        eddy_viscous=np.array([1.5, 1.2, 1.0]) * 1e-4,
        inverter_linear=np.full(3, 1.5),
        inverter_square=np.full(3, 0.05),
        motor_capacity=np.array([4.0, 3.0, 2.5]) * 1e3,
        gear_capacity=np.array([12.0, 9.0, 7.0]) * 1e3,
        motor_conductance=np.array([8.0, 7.0, 6.0]),
        gear_conductance=np.array([3.0, 2.5, 2.0]),
        friction_to_motor=np.full(3, 0.1),
        acceleration=np.array([0.8, 1.2, 2.0]),
        supply=SUPPLY,
    )


def testbed_profile() -> PlantProfile:
    """Return a plant of the TestBed class gantry; speeds and forces of its motors in rad, N m."""
    class_coulomb = np.array([0.9, 0.45, 0.25])
    cold = np.array([3.0, 2.0, 1.5]) * 1e-3
    return PlantProfile(
        body="testbed",
        lubricant=(VG220_SYNTHETIC,) * 3,
        coulomb=0.88 * class_coulomb,
        load_coulomb=np.array([0.04, 0.04, 0.08]),
        stribeck=0.12 * class_coulomb,
        stribeck_velocity=np.array([12.0, 12.0, 8.0]),
        viscous_40=_viscous((VG220_SYNTHETIC,) * 3, cold, 0.35 * cold),
        torque_constant=np.array([1.0, 0.9, 0.8]),
        torque_constant_fall=np.full(3, 0.0011),
        resistance=np.array([1.2, 1.3, 2.2]),
        resistance_rise=np.full(3, 0.0039),
        hysteresis_torque=np.array([0.05, 0.04, 0.03]),
        eddy_viscous=np.full(3, 1.5e-4),
        inverter_linear=np.full(3, 2.5),
        inverter_square=np.full(3, 0.05),
        motor_capacity=np.array([5.0, 4.0, 3.0]) * 1e3,
        gear_capacity=np.array([15.0, 12.0, 10.0]) * 1e3,
        motor_conductance=np.array([9.0, 8.0, 7.0]),
        gear_conductance=np.array([3.5, 3.0, 2.5]),
        friction_to_motor=np.full(3, 0.1),
        acceleration=np.array([0.8, 1.0, 0.4]),
        supply=SUPPLY,
    )


def irb4600_profile() -> PlantProfile:
    """Return a plant of the IRB 4600-40/2.55 class."""
    class_coulomb = np.array([1.4, 1.3, 0.37, 0.24, 0.21, 0.20])
    cold = np.array([24.0, 22.0, 17.0, 3.3, 3.1, 3.6]) * 1e-3
    oils = (VG220_SYNTHETIC,) * 6
    return PlantProfile(
        body="irb4600",
        lubricant=oils,
        coulomb=0.82 * class_coulomb,
        load_coulomb=np.full(6, 0.03),
        stribeck=0.18 * class_coulomb,
        stribeck_velocity=np.full(6, 15.0),
        viscous_40=_viscous(oils, cold, 0.32 * cold),
        torque_constant=np.array([1.4, 1.4, 1.2, 0.8, 0.8, 0.8]),
        torque_constant_fall=np.full(6, 0.0011),
        resistance=np.array([0.45, 0.45, 0.9, 3.0, 3.0, 3.0]),
        resistance_rise=np.full(6, 0.0039),
        hysteresis_torque=np.array([0.08, 0.08, 0.05, 0.015, 0.015, 0.015]),
        eddy_viscous=np.array([3.0, 3.0, 2.0, 0.6, 0.6, 0.6]) * 1e-4,
        inverter_linear=np.full(6, 3.0),
        inverter_square=np.full(6, 0.05),
        motor_capacity=np.array([9.0, 9.0, 6.0, 1.5, 1.5, 1.5]) * 1e3,
        gear_capacity=np.array([40.0, 35.0, 25.0, 6.0, 4.0, 4.0]) * 1e3,
        motor_conductance=np.array([14.0, 14.0, 10.0, 3.5, 3.5, 3.5]),
        gear_conductance=np.array([6.0, 5.0, 4.0, 1.5, 1.0, 1.0]),
        friction_to_motor=np.full(6, 0.1),
        acceleration=np.array([5.0, 4.0, 5.0, 17.0, 15.0, 18.0]),
        supply=SupplyProfile(
            loss_dc=160.0,
            loss_grid=220.0,
            rectifier_efficiency=0.985,
            capacitance=2.0e-3,
            rectified_voltage=566.0,
            chopper_on_voltage=700.0,
            chopper_off_voltage=680.0,
            brake_resistance=20.0,
        ),
    )


def _viscous(oils: tuple[Lubricant, ...], cold: Float, hot: Float) -> Float:
    """Coefficients at 40 degC whose curves pass near both targets (20 and 60 degC)."""
    return np.array(
        [calibrated_viscous(oil, a, b) for oil, a, b in zip(oils, cold, hot, strict=True)]
    )
