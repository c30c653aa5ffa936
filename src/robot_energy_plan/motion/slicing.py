"""STL shape -> layers -> G-code of a printing program (paper B, section 5.2.1).

Each layer is cut at half its height and its outlines are traced at constant speed, at the height
of its top. There is no infill, as in paper B. Trimesh reads and cuts the shape, Shapely divides a
layer along the cuts and moves the outlines inward by half a bead.

Inside a shape is what its surfaces wind around: a body that stands twice, or bodies that touch or
overlap, count once. A surface whose normals point inward bounds a hole.
"""

from __future__ import annotations

import io
import logging
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import MotionError
from robot_energy.foundation.extras import require
from robot_energy.foundation.files.regular_file import read_regular, why_unreadable
from robot_energy.timeline.blocks import Float

MAX_BYTES = 256 * 1024 * 1024
MAX_LAYERS = 10_000
MAX_SIZE = 100.0  # of a shape [m]
GRID = 1e-7  # within which ends of cuts are one point [m]
TOUCHING = 1e-6  # half of a gap between bodies that touch but for rounding [m]
MAX_CHORD = 1e-4  # greatest distance of a simplified outline from the cut [m]
UNITS = {"mm": 1e-3, "m": 1.0, "inch": 0.0254}
FEED_FACTOR = 60e3  # m/s to mm/min

LengthUnit = Literal["mm", "m", "inch"]


class Slicing(Described):
    """How a shape becomes a program."""

    layer_height: Annotated[float, "Of every layer. [m]"] = 0.01
    speed: Annotated[float, "Of the tool along the outlines. [m/s]"] = 0.125
    bead_width: Annotated[float, "The path runs half of it inside; 0: on the surface. [m]"] = 0.0
    unit: Annotated[LengthUnit, "Of the coordinates in the file, which does not state it."] = "mm"

    def __post_init__(self) -> None:
        for name in ("layer_height", "speed"):
            value = getattr(self, name)
            if not 0.0 < value < MAX_SIZE:
                raise MotionError(f"{name.replace('_', ' ')} is {value:g}", "a value > 0")
        if not 0.0 <= self.bead_width < MAX_SIZE:
            raise MotionError(f"bead width is {self.bead_width:g} m", "0 or more")


class SlicedShape(Described):
    """A shape in layers."""

    gcode: Annotated[str, "The program; lengths in mm, coordinates of the file."]
    layers: int
    notes: tuple[str, ...]


def slice_stl(path: str | Path, slicing: Slicing | None = None) -> SlicedShape:
    """Return the program that traces the outlines of an STL file, cut into layers.

    It begins each outline at the point nearest to where the last one ended and moves there without
    printing.
    """
    options = slicing or Slicing()
    mesh = _mesh(Path(path), UNITS[options.unit])
    bottom, top = float(mesh.bounds[0, 2]), float(mesh.bounds[1, 2])
    count = math.floor((top - bottom) / options.layer_height + 1e-6)
    if not 1 <= count <= MAX_LAYERS:
        raise MotionError(
            f"{path} is {(top - bottom) * 1e3:g} mm high: {count} layers of "
            f"{options.layer_height * 1e3:g} mm",
            f"1 to {MAX_LAYERS} layers",
            "check the layer height and the unit of the file",
        )
    open_cuts = empty = undecided = 0
    layers: list[tuple[float, list[Float]]] = []
    for layer, cut in enumerate(_cuts(mesh, bottom, count, options.layer_height), 1):
        area, rest, agrees = _area(cut)
        rings = _outlines(area, 0.5 * options.bead_width)
        open_cuts += rest
        empty += not rings
        undecided += not agrees
        layers.append((bottom + layer * options.layer_height, rings))
    outlines = sum(len(rings) for _, rings in layers)
    if not outlines and open_cuts:
        raise MotionError(
            f"no layer of {path} has a closed outline: {open_cuts} open cuts",
            "a closed surface",
            "close its holes with the repair of a mesh program",
        )
    if not outlines:
        raise MotionError(
            f"no layer of {path} is wider than a bead of {options.bead_width * 1e3:g} mm",
            "a wider shape",
            "check the bead width and the unit of the file",
        )
    notes = [f"{path} was cut into {count} layers, {outlines} outlines; without infill"]
    if open_cuts:
        notes.append(f"the shape has holes: {open_cuts} open cuts are left out")
    if empty:
        notes.append(f"{empty} of {count} layers have no outline and are left out")
    if undecided:
        notes.append(
            f"in {undecided} layers the normals of the triangles do not agree: an outline within "
            "an outline was taken as a hole"
        )
    return SlicedShape(_traced(Path(path).name, options, layers), count, tuple(notes))


def _mesh(path: Path, unit: float) -> Any:
    require("trimesh", "a shape")
    require("shapely", "a shape")
    import trimesh

    reader: Any = trimesh
    try:
        data = read_regular(path, MAX_BYTES)
    except OSError as error:
        raise MotionError(
            f"{path} cannot be read ({why_unreadable(error)})", "an STL file"
        ) from error
    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # else it prints tracebacks
    try:
        with np.errstate(all="ignore"):
            mesh: Any = reader.load(io.BytesIO(data), file_type="stl", force="mesh")
            size = float(np.ptp(mesh.bounds, axis=0).max()) * unit
    except Exception as error:  # of any kind: the reader does not check its input
        raise MotionError(f"{path} holds no shape", "an STL file with triangles") from error
    if not 0.0 < size <= MAX_SIZE:
        raise MotionError(
            f"{path} is {size:g} m large", f"up to {MAX_SIZE:g} m", "check the unit of the file"
        )
    mesh.apply_scale(unit)
    return mesh


def _cuts(mesh: Any, bottom: float, count: int, layer_height: float) -> list[Float]:
    """Segments of the cut of each layer, inside to the left, shape (K, 2, 2). [m]"""
    from trimesh import intersections

    cutter: Any = intersections
    heights = (np.arange(count) + 0.5) * layer_height
    corners = np.unique(np.asarray(mesh.vertices)[:, 2] - bottom)
    above = np.minimum(np.searchsorted(corners, heights), len(corners) - 1)
    nearest = np.minimum(
        np.abs(corners[above] - heights), np.abs(corners[np.maximum(above - 1, 0)] - heights)
    )
    heights = heights + np.where(nearest < GRID, 2 * GRID, 0.0)  # never along a triangle
    lines, transforms, faces = cutter.mesh_multiplane(
        mesh, [0.0, 0.0, bottom], [0.0, 0.0, 1.0], heights
    )
    triangles = np.asarray(mesh.triangles)
    across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    found: list[Float] = []
    for part, transform, face in zip(lines, transforms, faces, strict=True):
        cut = np.asarray(part).reshape(-1, 2, 2) @ transform[:2, :2].T + transform[:2, 3]
        way, outward = cut[:, 1] - cut[:, 0], across[np.asarray(face, dtype=np.int64), :2]
        turned = outward[:, 0] * way[:, 1] - outward[:, 1] * way[:, 0] < 0.0
        cut[turned] = cut[turned, ::-1]
        found.append(cut)
    return found


def _area(cut: Float) -> tuple[Any, int, bool]:
    """Inside of a cut; number of open cuts; whether the sides of the triangles agree.

    The cut divides the plane into faces. A face is inside if the cut winds around it.
    """
    import shapely

    plane: Any = shapely
    segments = np.round(cut / GRID) * GRID
    segments = segments[np.any(segments[:, 0] != segments[:, 1], axis=1)]
    if not len(segments):
        return plane.Polygon(), 0, True
    edges = plane.union_all(plane.linestrings(segments), grid_size=GRID)
    faces, bridges, dangles, _ = plane.polygonize_full([edges])
    rest = plane.line_merge(plane.union_all([bridges, dangles]))
    if not rest.is_empty:
        segments = segments[plane.distance(plane.points(segments.mean(axis=1)), rest) > GRID]
    points, places = np.unique(segments.reshape(-1, 2), axis=0, return_inverse=True)
    ends = places.reshape(-1, 2)
    balance = np.bincount(ends[:, 0], minlength=len(points)) - np.bincount(
        ends[:, 1], minlength=len(points)
    )
    agrees = not balance.any()
    if not agrees:  # every edge once, from even to odd
        corners, line = plane.get_coordinates(plane.get_parts(edges), return_index=True)
        segments = np.stack([corners[:-1], corners[1:]], axis=1)[line[:-1] == line[1:]]
    inside = [
        face
        for face in plane.get_parts(faces)
        if (turns := _winding(np.array(face.representative_point().coords[0]), segments)) % 2
        or (agrees and turns)
    ]
    area = plane.union_all(inside)
    if len(inside) > 1:  # close what rounding left between touching bodies
        area = area.buffer(TOUCHING, join_style="mitre").buffer(-TOUCHING, join_style="mitre")
    return area, len(plane.get_parts(rest)), agrees


def _winding(point: Float, segments: Float) -> int:
    """How often segments wind around a point, by those that cross the ray along +x."""
    (x, y), (u, v) = segments[:, 0].T, segments[:, 1].T
    up, down = (y <= point[1]) & (v > point[1]), (v <= point[1]) & (y > point[1])
    left = (u - x) * (point[1] - y) - (v - y) * (point[0] - x)
    return int(np.count_nonzero(up & (left > 0)) - np.count_nonzero(down & (left < 0)))


def _outlines(area: Any, inset: float) -> list[Float]:
    """Outlines of an area, each of shape (K, 2), the last point as the first."""
    import shapely

    if inset > 0.0:
        area = area.buffer(-inset, join_style="mitre")
    plane: Any = shapely
    polygons = [part for part in plane.get_parts(area) if not part.is_empty]
    closed = [ring for part in polygons for ring in (part.exterior, *part.interiors)]
    return [np.asarray(line.simplify(MAX_CHORD).coords)[:, :2] for line in closed]


def _traced(name: str, options: Slicing, layers: Sequence[tuple[float, list[Float]]]) -> str:
    """The program that traces the outlines of layers at their heights, the nearest first."""
    height, speed = options.layer_height * 1e3, options.speed * 1e3
    lines = [
        f"; {name}: layers of {height:g} mm, {speed:g} mm/s; infill: none",
        "; made by robot-energy",
        ";FLAVOR:LinuxCNC",  # G0 moves at the rapid speed
        *("G21 ; mm", "G90 ; absolute", "M83 ; E counts from line to line"),
    ]
    feed, place = f"F{options.speed * FEED_FACTOR:.10g}", np.zeros(2)
    for number, (top, rings) in enumerate(layers, 1):
        left = list(rings)
        lines.append(f"; layer {number}")
        while left:
            nearest = [float(np.min(np.hypot(*(ring - place).T))) for ring in left]
            ring = left.pop(int(np.argmin(nearest)))[:-1]
            ring = np.roll(ring, -int(np.argmin(np.hypot(*(ring - place).T))), axis=0)
            place = ring[0]
            lines.append(f"G0 {_words(*ring[0], top)}")
            lines += [f"G1 {_words(x, y)} E1 {feed}" for x, y in (*ring[1:], ring[0])]
    return "\n".join([*lines, "M2"]) + "\n"


def _words(*place: float) -> str:
    return " ".join(
        f"{axis}{round(value * 1e3, 4):.10g}" for axis, value in zip("XYZ", place, strict=False)
    )
