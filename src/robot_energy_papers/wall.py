"""The printed wall of paper B as G-code, so that it goes the way every program goes.

Paper B, section 5.2.2: a simplified wall plan of 1200 mm by 300 mm, printed at a constant
path speed of 125 mm/s; section 5.2.3: 100 layers make 1 m. Its text states no infill and its
figure of the path is lost, so the outline alone is printed unless an infill is asked for.
"""

from __future__ import annotations

from typing import Annotated

from robot_energy.foundation.described import Described

MILLIMETRE = 1e-3  # m
FEED_FACTOR = 60.0 / MILLIMETRE  # m/s to mm/min


class Wall(Described):
    """A wall printed layer by layer; the tool begins each layer in the corner at the origin."""

    length: Annotated[float, "Length of the plan along x. [m]"] = 1.2
    width: Annotated[float, "Width of the plan along y. [m]"] = 0.3
    layer_height: Annotated[float, "Rise from layer to layer. [m]"] = 0.01
    layers: int = 1
    speed: Annotated[float, "Path speed, the rise included. [m/s]"] = 0.125
    infill: Annotated[int, "Strokes of a zigzag inside the outline, and as many back."] = 0

    @property
    def corners(self) -> list[tuple[float, float]]:
        """Places of the ends of all lines of a layer, after the first corner: x, y. [m]"""
        outline = [(self.length, 0.0), (self.length, self.width), (0.0, self.width), (0.0, 0.0)]
        along = [*range(1, self.infill + 1), *range(self.infill - 1, -1, -1)] * bool(self.infill)
        return outline + [
            (self.length * place / self.infill, self.width * (number % 2))
            for number, place in enumerate(along, 1)
        ]

    def gcode(self) -> str:
        """Return the program."""
        lines = [
            "; wall plan of paper B (Robotics 2024, 13(5), 78), sections 5.2.2 and 5.2.3",
            f"; {_mm(self.length)} mm by {_mm(self.width)} mm, {self.layers} layer(s) of "
            f"{_mm(self.layer_height)} mm, {_mm(self.speed)} mm/s; infill: {self.infill or 'none'}",
            "; made by robot_energy_papers.wall",
            "G21 ; mm",
            "G90 ; absolute",
            "G17 ; arcs, if any, are horizontal",
            "G0 X0 Y0 Z0",
        ]
        feed = f" F{self.speed * FEED_FACTOR:.10g}"
        for layer in range(self.layers):
            lines.append(f"; layer {layer + 1}")
            if layer:
                lines.append(f"G1 Z{_mm(layer * self.layer_height)}{feed}")
            for x, y in self.corners:
                lines.append(f"G1 X{_mm(x)} Y{_mm(y)}{feed}")
        lines.append("M2")
        return "\n".join(lines) + "\n"


def _mm(metre: float) -> str:
    return f"{round(metre / MILLIMETRE, 6):.10g}"
