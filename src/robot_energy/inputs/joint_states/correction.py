"""Sign, scale and zero of a quantity of all joints: the same for bags, live inputs and logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from robot_energy.foundation.errors import ParameterError
from robot_energy.inputs.parameters import parameter
from robot_energy.timeline.blocks import Float

MAX_SCALE = 1e9
MAX_ZERO = 1e6  # rad, rad/s, N m or what else the quantity has


@dataclass(frozen=True, kw_only=True)
class JointCorrection:
    """What turns logged values of the joints into those of the URDF.

    ``value = sign * scale * logged + zero``, for each joint; one entry stands for all joints.
    """

    sign: tuple[float, ...] = parameter(
        "1 or -1, one for all joints or one for each in the order of the model: -1 where the "
        "messages count the other way than the URDF [-].",
        (1.0,),
        (-1.0, 1.0),
    )
    scale: tuple[float, ...] = parameter(
        "Factor on the values, one for all joints or one for each: 0.017453292519943295 where "
        "they are in degrees [-].",
        (1.0,),
        (1 / MAX_SCALE, MAX_SCALE),
    )
    zero: tuple[float, ...] = parameter(
        "Added last, one for all joints or one for each: the value in the URDF where the "
        "messages say 0 [of the quantity, in SI].",
        (0.0,),
        (-MAX_ZERO, MAX_ZERO),
    )

    def __post_init__(self) -> None:
        for value in self.sign:
            if abs(value) != 1.0:
                raise ParameterError(f"sign has the entry {value:g}", "1 or -1")

    def check(self, joints: Sequence[str], owner: str) -> None:
        """Refuse a number of entries that fits neither all joints at once nor each of them."""
        for entry in fields(self):
            count = len(getattr(self, entry.name))
            if count not in (1, len(joints)):
                raise ParameterError(
                    f"{owner}.{entry.name} has {count} entries",
                    f"1 for all joints, or {len(joints)}, one for each of {', '.join(joints)}",
                )

    def apply(self, values: Float) -> Float:
        """Return values of the URDF's joints; NaN stays NaN, ``values`` where nothing is corrected.

        Args:
            values: As logged, in SI, shape (N, n). [rad], [rad/s], [N m] or [A]
        """
        if self == _NONE:
            return values
        return values * (np.asarray(self.sign) * np.asarray(self.scale)) + np.asarray(self.zero)

    def followed_by(self, other: JointCorrection) -> JointCorrection:
        """Return the one correction that does the work of this one and then of another."""
        factor = np.asarray(other.sign) * np.asarray(other.scale)
        return JointCorrection(
            sign=_shortest(np.asarray(self.sign) * np.asarray(other.sign)),
            scale=_shortest(np.asarray(self.scale) * np.asarray(other.scale)),
            zero=_shortest(np.asarray(self.zero) * factor + np.asarray(other.zero)),
        )

    def line(self, quantity: str) -> str:
        """Return its line of YAML, as ``effort: {sign: [1, -1]}``; empty where it does nothing."""
        parts = [
            f"{entry.name}: [{', '.join(_number(value, entry.name) for value in values)}]"
            for entry in fields(self)
            if set(values := getattr(self, entry.name)) != set(getattr(_NONE, entry.name))
        ]
        return f"{quantity}: {{{', '.join(parts)}}}" if parts else ""


def _shortest(values: Float) -> tuple[float, ...]:
    """One entry where all are equal."""
    found = tuple(np.atleast_1d(values).tolist())
    return found[:1] if len(set(found)) == 1 else found


def _number(value: float, key: str) -> str:
    """A number as ROS wants it in a list: all with a point, or none."""
    if key == "sign":
        return str(int(value))
    mantissa, e, exponent = f"{value:.9g}".partition("e")
    return (mantissa if "." in mantissa else f"{mantissa}.0") + e + exponent


_NONE = JointCorrection()
