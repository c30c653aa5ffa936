"""Text of a first model file: priors scaled to each joint, with a comment for every section."""

from __future__ import annotations

import os
from pathlib import Path
from textwrap import fill, indent

import yaml

from robot_energy.foundation.shown_text import MAX_LINE, shown
from robot_energy_identify.starter.arm import Arm, ArmJoint
from robot_energy_identify.starter.description import RobotText
from robot_energy_identify.starter.priors import SHAPE_A, SHAPE_B, SHAPE_C, RobotClass, Share

WIDTH = 92
RATIO_SPREAD = 0.01  # of a gear ratio that the URDF states
ROTOR_SPREAD = 0.1  # of its rotor inertia: the gear's fast parts are often left out
FRICTION_SPREAD = 0.3  # of its friction: it states no temperature
HOT = f"{SHAPE_A:g} of the viscous friction at 20 degC"


def starter_text(arm: Arm, description: RobotText, folder: str | Path) -> str:
    """Return the model file, as YAML for a folder, of an arm that nobody has measured."""
    joints = "".join(_joint(joint, arm.robot_class) for joint in arm.joints)
    urdf = _urdf(arm, description, Path(folder))
    return "\n".join([_head(arm, description), urdf, f"joints:\n{joints}", _electrical(arm)])


def _number(value: float) -> str:
    """Write three significant digits as YAML reads them back: 1.0e-05, not 1e-05."""
    return yaml.safe_dump(float(f"{value:.3g}")).splitlines()[0]


def _figure(value: float, spread: float, source: str, published: bool = False) -> str:
    """Write a prior, or a figure of the URDF with all its digits."""
    text, tag = _number(value), "assumed"
    if published:
        text, tag = yaml.safe_dump(float(value)).splitlines()[0], "published"
        source += " of the URDF"
    std = _number(abs(value) * spread)
    return f'{{value: {text}, tag: {tag}, std: {std}, source: "{source}"}}'


def _share(share: Share, scale: float, source: str) -> str:
    return _figure(share.value * scale, share.spread, f"{100 * share.value:.3g} % {source}")


def _comment(text: str, bullet: str = "") -> str:
    return indent(
        fill(
            shown(text, MAX_LINE), WIDTH, initial_indent=bullet, subsequent_indent=" " * len(bullet)
        ),
        "# ",
    )


def _head(arm: Arm, description: RobotText) -> str:
    left = [f"{name}: not modelled ({why})" for name, why in arm.left_out]
    lines = [
        _comment(
            f"First model of {arm.robot_name}, made from the {description.origin}. No figure was "
            "measured: gears, rotors, friction, drives and cabinet are priors, scaled from the "
            "limits of each joint, each with a wide standard deviation (std), except those with "
            "the tag published, which the URDF states. Their sources stand "
            "in the documentation, page 'Priors of a first model'. Expect the predicted energy "
            "to be off by a third, and by more in the cold."
        ),
        "#",
        _comment("To replace the priors by figures of your robot, from recordings:"),
        "#   robot-energy identify all RECORDINGS... --model THIS_FILE --out identified.yaml",
        "#",
        _comment(f"Class: {arm.robot_class.name}, {arm.robot_class.label} ({arm.class_source})."),
        *(_comment(text, "- ") for text in (*arm.remarks, *left)),
        "schema_version: 1",
        "robot:",
        f"  type: {_quoted(arm.robot_name)}",
        '  serial: ""  # set it if you run several robots of this type',
    ]
    return "\n".join(lines)


def _urdf(arm: Arm, description: RobotText, folder: Path) -> str:
    lines = ["urdf:"]
    if description.path is not None:
        lines.append(f"  path: {_quoted(os.path.relpath(description.path, folder))}")
    else:
        lines.append(_embedded(description.xml))
    lines += [
        "  tags: {kinematics: published, masses: published}  # as far as you trust the URDF",
        f"  source: {_quoted(description.origin)}",
        "gravity: [0.0, 0.0, -9.80665]  # in the base frame, m/s^2; change it for other mountings",
    ]
    if arm.massless_links:
        names = ", ".join(_quoted(name) for name in arm.massless_links)
        lines.append(f"massless_links: [{names}]  # they move without mass")
    return "\n".join(lines)


def _embedded(xml: str) -> str:
    """Write the URDF as a block that can be read, or quoted where YAML would change a line end."""
    block = "  xml: |\n" + indent(xml.strip("\n"), "    ", lambda line: True)
    try:
        if yaml.safe_load(block)["xml"] == xml.strip("\n"):
            return block
    except yaml.YAMLError:
        pass
    return indent(yaml.safe_dump({"xml": xml}, default_style='"').replace('"xml"', "xml", 1), "  ")


def _joint(joint: ArmJoint, robot: RobotClass) -> str:
    """Write one joint: what the URDF gives, moved to the motor side, and priors for the rest."""
    given = joint.actuator
    ratio, ratio_figure = _ratio(joint, robot)
    torque, speed = joint.effort / abs(ratio), joint.velocity * abs(ratio)
    force, rate = joint.units
    of_power = "of peak power"
    rotor = _figure(
        robot.rotor.value * torque / speed,
        robot.rotor.spread,
        f"full torque speeds the rotor up in {robot.rotor.value:g} s",
    )
    if given.rotor_inertia is not None:
        rotor = _figure(given.rotor_inertia, ROTOR_SPREAD, "rotor inertia", True)
    coulomb = _share(robot.coulomb, torque, "of the torque limit, motor side")
    if given.friction is not None:
        source = f"friction {given.friction:g} {force}, joint side,"
        coulomb = _figure(given.friction / abs(ratio), FRICTION_SPREAD, source, True)
    if given.damping is not None:
        source = f"damping {given.damping:g} {force} per {rate}, joint side,"
        viscous = _figure(given.damping / ratio**2, FRICTION_SPREAD, source, True)
        law = f"  # N m s/rad\n        law: constant\n        viscous: {viscous}\n"
    else:
        size, spread = robot.viscous.value * torque / speed, robot.viscous.spread
        cold = f"{100 * robot.viscous.value:.3g} % of the torque limit at full speed and 20 degC"
        law = (
            f"  # a + b exp(-T / c), N m s/rad, T in degC\n"
            f"        law: exponential\n"
            f"        a: {_figure(SHAPE_A * size, spread, HOT)}\n"
            f"        b: {_figure(SHAPE_B * size, spread, cold)}\n"
            f"        c: {_figure(SHAPE_C, 0.2, 'shape of an ABB robot, Bittencourt, recalled')}\n"
            f"        fitted_degc: [{robot.fitted_degc[0]}, {robot.fitted_degc[1]}]\n"
            f"        std: {_number(size * spread)}\n"
        )
    return (
        f"  - name: {_quoted(joint.name)}  # limits {joint.effort:.4g} {force}, "
        f"{joint.velocity:.4g} {rate}\n"
        f"    gear_ratio: {ratio_figure}\n"
        f"    rotor_inertia:  # kg m^2, motor side\n"
        f"      {rotor}\n"
        f"    friction:  # motor side\n"
        f"      coulomb: {coulomb}  # N m\n"
        f"      viscous:{law}"
        f"    losses:  # of the drive\n"
        f"      constant: {_share(robot.constant, torque * speed, of_power)}  # W\n"
        f"      linear: {_share(robot.linear, torque, of_power)}  # W s/rad\n"
        f"      quadratic: {_share(robot.quadratic, torque / speed, of_power)}  # W s^2/rad^2\n"
        f"      copper: {_share(robot.copper, speed / torque, of_power)}  # W/(N m)^2\n"
    )


def _ratio(joint: ArmJoint, robot: RobotClass) -> tuple[float, str]:
    """Gear ratio and its figure: of the URDF, else as usual in the class."""
    given, usual, fastest = joint.actuator.gear_ratio, robot.gear_ratio, robot.max_motor_velocity
    if given is not None:
        return given, _figure(given, RATIO_SPREAD, "transmission", True)
    ratio, source = usual.value, f"usual of the class {robot.name}"
    if joint.prismatic:
        ratio, source = (fastest or 300.0) / joint.velocity, "motor at its usual speed limit"
    elif fastest is not None:
        ratio = min(max(fastest / joint.velocity, 30.0), 300.0)
        source = f"motor at {fastest:.0f} rad/s at full joint speed"
    return ratio, _figure(ratio, usual.spread, source)


def _electrical(arm: Arm) -> str:
    robot, peak = arm.robot_class, arm.peak_power
    grid = _loss(robot.loss_grid, robot.loss_grid_share, peak)
    dc = _loss(robot.loss_dc, robot.loss_dc_share, peak)
    return (
        "drive: loss_model  # shaft power plus the losses above\n"
        "cabinet:  # W\n"
        f"  loss_grid: {grid}  # controller, fans, supply\n"
        f"  loss_dc: {dc}  # electronics and released brakes\n"
        "temperature:\n"
        "  fallback_degc: 30.0  # taken while no motor temperature is known\n"
        "  stale_after: 60.0  # s\n"
        "payload: []  # bodies fixed to links; see the reference of the model file\n"
        "provenance:\n"
        f'  notes: "First model, class {robot.name}: nothing was measured."\n'
    )


def _loss(constant: Share, share: float, peak: float) -> str:
    source = f"{constant.value:g} W"
    if share:
        source += f" and {100 * share:.2g} % of the peak power of all joints, {peak / 1e3:.3g} kW"
    return _figure(constant.value + share * peak, constant.spread, source)


def _quoted(text: str) -> str:
    """Write a name as YAML on one line, quoted where it must be."""
    return yaml.safe_dump(text, default_style='"', allow_unicode=True, width=10_000).strip()
