"""What a URDF says of the drive of each joint: gear, rotor, friction.

- ``mechanicalReduction`` and ``drake:gear_ratio`` of a transmission: motor turns per joint turn.
- ``motorInertia`` and ``drake:rotor_inertia``: of the rotor, motor side, before the gear.
- ``dynamics`` of a joint: viscous damping and Coulomb friction, joint side.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
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


@dataclass
class _Found:
    """What is found, and what is left out: reason -> joints."""

    actuators: dict[str, Actuator]
    ignored: dict[str, list[str]] = field(default_factory=dict[str, list[str]])

    def ignore(self, joint: str, reason: str) -> None:
        """Note that something of a joint is not used."""
        names = self.ignored.setdefault(reason, [])
        if joint not in names:
            names.append(joint)


def read_actuators(
    root: ET.Element, joint_names: Sequence[str]
) -> tuple[dict[str, Actuator], list[str]]:
    """Return the drive of every joint, and a sentence for each kind of entry that is left out."""
    found = _Found({name: Actuator() for name in joint_names})
    for transmission in (
        *root.iterfind("transmission"),
        *root.iterfind("ros2_control/transmission"),
    ):
        _read_transmission(transmission, found)
    for joint in root.findall("joint"):
        _read_dynamics(joint, found)
    return found.actuators, [
        f"{first_names(names)}: {reason}" for reason, names in found.ignored.items()
    ]


def without_defaults(
    actuators: dict[str, Actuator], effort: Sequence[float], velocity: Sequence[float]
) -> tuple[dict[str, Actuator], list[str]]:
    """Return the drives without friction that no such joint can have, and say what was left out.

    Args:
        effort: Largest torque or force of each joint, joint side. [N m] or [N]
        velocity: Largest speed. [rad/s] or [m/s]
    """
    found = _Found(dict(actuators))
    given = {name: actuator for name, actuator in actuators.items() if _rubs(actuator)}
    pairs = {(actuator.damping, actuator.friction) for actuator in given.values()}
    strengths = {
        round(limit, 6) for name, limit in zip(actuators, effort, strict=True) if name in given
    }
    alike = len(given) >= MIN_EQUAL and len(pairs) == 1 and len(strengths) > 1
    for name, limit, speed in zip(actuators, effort, velocity, strict=True):
        actuator = actuators[name]
        if not _rubs(actuator):
            continue
        needed = (actuator.damping or 0.0) * speed + (actuator.friction or 0.0)
        if alike:
            reason = (
                "dynamics of the URDF is not used: it is the same for joints of different "
                "strength, as a default of a simulation is"
            )
        elif needed >= limit:
            reason = (
                "dynamics of the URDF is not used: friction at full speed would need all of the "
                "effort limit"
            )
        else:
            continue
        found.ignore(name, reason)
        found.actuators[name] = replace(actuator, damping=None, friction=None)
    return found.actuators, [
        f"{first_names(names)}: {reason}" for reason, names in found.ignored.items()
    ]


def _rubs(actuator: Actuator) -> bool:
    return actuator.damping is not None or actuator.friction is not None


def _read_transmission(transmission: ET.Element, found: _Found) -> None:
    joints = [str(joint.get("name")) for joint in transmission.findall("joint")]
    modelled = [name for name in joints if name in found.actuators]
    for name in modelled:
        actuator = found.actuators[name]
        ratio = _entry(transmission, _REDUCTIONS, name, found)
        inertia = _entry(transmission, _INERTIAS, name, found)
        if len(joints) > 1 and (ratio is not None or inertia is not None):
            found.ignore(name, "its transmission moves several joints; its figures are not used")
            continue
        if ratio is not None and ratio not in _UNKNOWN_RATIOS:
            if abs(ratio) < 1.0:
                found.ignore(
                    name,
                    f"gear ratio {ratio:.4g} of the URDF is not used: the motor would turn slower "
                    f"than the joint; is it {1 / ratio:.4g}?",
                )
            elif actuator.gear_ratio not in (None, ratio):
                found.ignore(name, f"gear ratio {ratio:.4g} is not used: the URDF gives another")
            else:
                actuator = replace(actuator, gear_ratio=ratio)
        if inertia is not None and inertia > 0.0:
            if actuator.gear_ratio is None:
                found.ignore(name, "rotor inertia of the URDF is not used: it gives no gear ratio")
            else:
                actuator = replace(actuator, rotor_inertia=inertia)
        elif inertia is not None and inertia < 0.0:
            found.ignore(
                name, f"rotor inertia {inertia:.4g} of the URDF is not used: it is below 0"
            )
        found.actuators[name] = actuator


def _entry(
    transmission: ET.Element, tags: Sequence[str], joint: str, found: _Found
) -> float | None:
    """Return a number of the actuator, or else of the joint, of a transmission."""
    places = (*transmission.findall("actuator"), *transmission.findall("joint"))
    for element in (part for place in places for part in place if part.tag in tags):
        text = (element.get("value") or element.text or "").strip()
        value = _number(text)
        if text and value is None:
            found.ignore(joint, f"{element.tag} '{shown(text, 40)}' of the URDF is not a number")
        return value
    return None


def _read_dynamics(joint: ET.Element, found: _Found) -> None:
    name, dynamics = str(joint.get("name")), joint.find("dynamics")
    if dynamics is None or name not in found.actuators:
        return
    values: dict[str, float] = {}
    for key in ("damping", "friction"):
        text = dynamics.get(key, "0")
        value = _number(text)
        if value is None or value < 0.0:
            found.ignore(
                name, f"{key} '{shown(text, 40)}' of the URDF is not used: no number of 0 or more"
            )
        elif value > 0.0:
            values[key] = value
    found.actuators[name] = replace(
        found.actuators[name], damping=values.get("damping"), friction=values.get("friction")
    )


def _number(text: str) -> float | None:
    """Return a finite number, None for anything else."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if np.isfinite(value) else None
