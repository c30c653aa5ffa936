"""What a URDF says of the drive of each joint: gear, rotor, friction.

- ``mechanicalReduction`` and ``drake:gear_ratio`` of a transmission: motor turns per joint turn.
- ``motorInertia`` and ``drake:rotor_inertia``: of the rotor, motor side, before the gear.
- ``dynamics`` of a joint: viscous damping and Coulomb friction, joint side.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.shown_text import shown
from robot_energy.physics.urdf.parse import first_names

_REDUCTIONS = ("mechanicalReduction", "mechanical_reduction", "drake:gear_ratio")
_INERTIAS = ("motorInertia", "drake:rotor_inertia")
_UNKNOWN_RATIOS = (0.0, 1.0, -1.0)  # what exporters write where they know no gear
MIN_EQUAL = 3
"""So many joints of different strength do not have the same friction: a simulation's default."""


class Actuator(Described):
    """Drive of one joint as far as the URDF states it; None where it does not."""

    gear_ratio: Annotated[float | None, "Motor turns per joint turn, signed. [-] or [rad/m]"] = None
    rotor_inertia: Annotated[float | None, "Motor side. [kg m^2]"] = None
    damping: Annotated[float | None, "Viscous friction, joint side. [N m s/rad] or [N s/m]"] = None
    friction: Annotated[float | None, "Coulomb friction, joint side. [N m] or [N]"] = None


Ignored = dict[str, dict[str, None]]  # what is left out: joints by reason


def read_actuators(
    root: ET.Element, joint_names: Sequence[str]
) -> tuple[dict[str, Actuator], list[str]]:
    """Return the drive of every joint, and a sentence for each kind of entry that is left out."""
    actuators, ignored = {name: Actuator() for name in joint_names}, Ignored()
    for path in ("transmission", "ros2_control/transmission"):
        for transmission in root.iterfind(path):
            _read_transmission(transmission, actuators, ignored)
    for joint in root.findall("joint"):
        name, dynamics = str(joint.get("name")), joint.find("dynamics")
        if dynamics is None or name not in actuators:
            continue
        values: dict[str, float] = {}
        for key in ("damping", "friction"):
            text = dynamics.get(key, "0")
            value = _number(text)
            if value is None or value < 0.0:
                reason = (
                    f"{key} '{shown(text, 40)}' of the URDF is not used: no number of 0 or more"
                )
                ignored.setdefault(reason, {})[name] = None
            elif value > 0.0:
                values[key] = value
        actuators[name] = replace(actuators[name], **{"damping": None, "friction": None, **values})
    return actuators, _sentences(ignored)


def _sentences(ignored: Ignored) -> list[str]:
    return [f"{first_names([*names])}: {reason}" for reason, names in ignored.items()]


def without_defaults(
    actuators: dict[str, Actuator], effort: Sequence[float], velocity: Sequence[float]
) -> tuple[dict[str, Actuator], list[str]]:
    """Return the drives without friction that no such joint can have, and say what was left out.

    Args:
        effort: Largest torque or force of each joint, joint side. [N m] or [N]
        velocity: Largest speed. [rad/s] or [m/s]
    """
    kept, ignored = dict(actuators), Ignored()
    given = {name: one for name, one in actuators.items() if _rubs(one)}
    limits = dict(zip(actuators, zip(effort, velocity, strict=True), strict=True))
    pairs = {(one.damping, one.friction) for one in given.values()}
    strengths = {round(limits[name][0], 6) for name in given}
    alike = len(given) >= MIN_EQUAL and len(pairs) == 1 and len(strengths) > 1
    for name, one in given.items():
        limit, speed = limits[name]
        if alike:
            why = "it is the same for joints of different strength, as a default of a simulation is"
        elif (one.damping or 0.0) * speed + (one.friction or 0.0) >= limit:
            why = "friction at full speed would need all of the effort limit"
        else:
            continue
        ignored.setdefault(f"dynamics of the URDF is not used: {why}", {})[name] = None
        kept[name] = replace(one, damping=None, friction=None)
    return kept, _sentences(ignored)


def _rubs(actuator: Actuator) -> bool:
    return actuator.damping is not None or actuator.friction is not None


def _read_transmission(
    transmission: ET.Element, actuators: dict[str, Actuator], ignored: Ignored
) -> None:
    joints = [str(joint.get("name")) for joint in transmission.findall("joint")]
    for name in (joint for joint in joints if joint in actuators):

        def ignore(reason: str, joint: str = name) -> None:
            ignored.setdefault(reason, {})[joint] = None

        actuator = actuators[name]
        ratio = _entry(transmission, _REDUCTIONS, ignore)
        inertia = _entry(transmission, _INERTIAS, ignore)
        if len(joints) > 1 and (ratio is not None or inertia is not None):
            ignore("its transmission moves several joints; its figures are not used")
            continue
        if ratio is not None and ratio not in _UNKNOWN_RATIOS:
            if abs(ratio) < 1.0:
                ignore(
                    f"gear ratio {ratio:.4g} of the URDF is not used: the motor would turn slower "
                    f"than the joint; is it {1 / ratio:.4g}?"
                )
            elif actuator.gear_ratio not in (None, ratio):
                ignore(f"gear ratio {ratio:.4g} is not used: the URDF gives another")
            else:
                actuator = replace(actuator, gear_ratio=ratio)
        if inertia is not None and inertia < 0.0:
            ignore(f"rotor inertia {inertia:.4g} of the URDF is not used: it is below 0")
        elif inertia and actuator.gear_ratio is None:
            ignore("rotor inertia of the URDF is not used: it gives no gear ratio")
        elif inertia:
            actuator = replace(actuator, rotor_inertia=inertia)
        actuators[name] = actuator


def _entry(
    transmission: ET.Element, tags: Sequence[str], ignore: Callable[[str], None]
) -> float | None:
    """Return a number of the actuator, or else of the joint, of a transmission."""
    places = (*transmission.findall("actuator"), *transmission.findall("joint"))
    for element in (part for place in places for part in place if part.tag in tags):
        text = (element.get("value") or element.text or "").strip()
        value = _number(text)
        if text and value is None:
            ignore(f"{element.tag} '{shown(text, 40)}' of the URDF is not a number")
        return value
    return None


def _number(text: str) -> float | None:
    """Return a finite number, None for anything else."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if np.isfinite(value) else None
