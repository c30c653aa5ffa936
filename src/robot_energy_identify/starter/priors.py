"""Priors of a robot nobody has measured: shares of each joint's limits in the URDF.

Each share is free of units, so that one table serves arms of every size. With the effort
limit tau, the velocity limit v and the gear ratio u of a joint, motor side
``tau_m = tau / u`` and ``w_m = u v``:

- Coulomb friction          ``coulomb * tau_m``                          [N m]
- viscous friction, 20 degC ``viscous * tau_m / w_m``                    [N m s/rad]
- rotor inertia             ``rotor * tau_m / w_m``, rotor in s          [kg m^2]
- copper loss               ``copper * w_m / tau_m``                     [W/(N m)^2]
- constant, linear, quadratic drive loss: shares of ``tau_m w_m``        [W] at full speed

The sources of the shares stand in ``src/doc/priors.md``.
"""

from __future__ import annotations

from typing import Annotated

from robot_energy.foundation.described import Described

# Shape of viscous friction over temperature: fv(T) = fv(20) (A + B exp(-T / C)), T in degC.
SHAPE_A = 0.206
SHAPE_B = 2.089
SHAPE_C = 20.71  # [K]


class Share(Described):
    """One prior."""

    value: float
    spread: Annotated[float, "Standard deviation, as a share of the value."]


class RobotClass(Described):
    """Priors of one class of robots."""

    name: str
    label: str
    gear_ratio: Annotated[Share, "Motor turns per joint turn, without a transmission. [-]"]
    max_motor_velocity: Annotated[
        float | None, "Of a motor; the gear ratio is this over the velocity limit. [rad/s]"
    ]
    velocity: Annotated[Share, "Velocity limit of a rotary joint where the URDF has none. [rad/s]"]
    rise_time: Annotated[float, "Time to full speed, for effort limits that lack. [s]"]
    coulomb: Share
    viscous: Annotated[Share, "Viscous friction at full speed and 20 degC over the effort limit."]
    rotor: Annotated[Share, "Time in which full effort brings the rotor alone to full speed. [s]"]
    copper: Annotated[Share, "Copper loss at full effort over the peak power of the joint."]
    constant: Annotated[Share, "Loss of the idle drive over the peak power of the joint."]
    linear: Annotated[Share, "Loss in proportion to speed, at full speed, over the peak power."]
    quadratic: Annotated[Share, "Loss with speed squared, at full speed, over the peak power."]
    loss_grid: Annotated[Share, "Controller, fans and supply, before the DC link. [W]"]
    loss_grid_share: Annotated[float, "The same, over the sum of the joints' peak powers."]
    loss_dc: Annotated[Share, "Electronics and released brakes on the DC link. [W]"]
    loss_dc_share: Annotated[float, "The same, over the sum of the peak powers."]
    fitted_degc: Annotated[tuple[float, float], "Range of the friction law. [degC]"]


CLASSES = {
    "cobot": RobotClass(
        name="cobot",
        label="collaborative robot, strain-wave gears, low-voltage bus",
        gear_ratio=Share(100.0, 0.3),
        max_motor_velocity=None,
        velocity=Share(3.14, 0.4),
        rise_time=0.3,
        coulomb=Share(0.05, 0.6),
        viscous=Share(0.20, 0.6),
        rotor=Share(0.025, 0.6),
        copper=Share(0.10, 0.6),
        constant=Share(0.005, 0.8),
        linear=Share(0.004, 0.8),
        quadratic=Share(0.002, 0.8),
        loss_grid=Share(60.0, 0.5),
        loss_grid_share=0.0,
        loss_dc=Share(30.0, 0.6),
        loss_dc_share=0.0,
        fitted_degc=(20.0, 60.0),
    ),
    "industrial": RobotClass(
        name="industrial",
        label="industrial robot, cycloidal or planetary gears, rectified mains",
        gear_ratio=Share(120.0, 0.5),
        max_motor_velocity=400.0,
        velocity=Share(3.0, 0.4),
        rise_time=0.3,
        coulomb=Share(0.06, 0.6),
        viscous=Share(0.22, 0.6),
        rotor=Share(0.025, 0.6),
        copper=Share(0.09, 0.6),
        constant=Share(0.002, 0.8),
        linear=Share(0.004, 0.8),
        quadratic=Share(0.002, 0.8),
        loss_grid=Share(100.0, 0.5),
        loss_grid_share=0.008,
        loss_dc=Share(50.0, 0.6),
        loss_dc_share=0.006,
        fitted_degc=(20.0, 80.0),
    ),
}
MAX_COBOT_PEAK = 4000.0
"""Sum of the joints' peak powers up to which a robot is taken for a cobot. [W]"""
MAX_COBOT_MASS = 60.0
"""Moving mass up to which a robot is taken for a cobot. [kg]"""
