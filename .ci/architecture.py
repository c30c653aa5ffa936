"""Picture of the packages, and of the folders of the core, drawn from their imports.

``python .ci/architecture.py`` writes `src/doc/images/architecture.svg`. It says of a package what
the first line of its docstring says. Imports for type checkers alone are left out, and so are
arrows between packages that others lead along. Where two folders of the core import each other,
the direction of most imports gives the order.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from graphlib import TopologicalSorter
from html import escape
from pathlib import Path
from textwrap import wrap

from lines import PACKAGES, ROOT

PICTURE = ROOT / "src/doc/images/architecture.svg"
CORE = "robot_energy"
# Columns of the packages, from the left, so that arrows cross no box; the last one for all others.
COLUMNS = {
    **{"ros2_energy_monitor": 0, "robot_energy_history": 0},
    **{"robot_energy_plan": 1, "robot_energy_rig": 1},
}
WIDTH, MARGIN, GAP = 1000, 16, 30
BOX = (WIDTH - 4 * MARGIN) // 3
HEIGHT, LINE = 54, 14
LEGEND = (
    "An arrow leads from a package to one that it imports, thicker where more",
    "imports do; it is left out where other arrows lead there. All packages",
    "import the core. A folder of the core imports from the rows below it, but",
    "for modules that test/unit/test_import_graph.py names.",
)
HEAD = f"""\
<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {{height}}" width="{WIDTH}"
 font-family="sans-serif" font-size="11.5">
<title>The packages by their imports</title>
<!-- written by .ci/architecture.py -->
<defs><marker id="end" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="9" markerHeight="9"
 markerUnits="userSpaceOnUse" orient="auto"><path d="M0 0 8 4 0 8z" fill="#444"/></marker></defs>
<rect width="100%" height="100%" fill="#fff"/>
"""
Edges = Counter[tuple[str, str]]


def main() -> None:
    """Write the picture."""
    PICTURE.write_text(picture(), encoding="utf-8")
    print(f"wrote {PICTURE.relative_to(ROOT)}")


def picture() -> str:
    """Return the picture as SVG."""
    packages, folders = imports()
    floors = levels(packages)
    core = MARGIN + max(floors.values()) * (HEIGHT + GAP)
    place = {
        name: (MARGIN + COLUMNS.get(name, 2) * (BOX + MARGIN), core - floors[name] * (HEIGHT + GAP))
        for name in PACKAGES
        if name != CORE
    }
    inner: list[str] = []
    below = core + 24
    for row in rows_of(levels(folders)):
        width = (WIDTH - 3 * MARGIN) // len(row) - 8
        said = [said_of(PACKAGES[CORE] / name, width) for name in row]
        height = 24 + LINE * max(map(len, said))
        for column, (name, lines) in enumerate(zip(row, said, strict=True)):
            x = MARGIN + 12 + column * (width + 8)
            inner.append(box((x, below), (width, height), name, lines, "#fff"))
        below += height + 6
    drawn = [text(MARGIN, 30 + 16 * row, line) for row, line in enumerate(LEGEND)]
    drawn += [
        box(corner, (BOX, HEIGHT), name, said_of(PACKAGES[name], BOX), "#e8f0fa")
        for name, corner in place.items()
    ]
    outer = (WIDTH - 2 * MARGIN, below + 6 - core)
    drawn += [box((MARGIN, core), outer, CORE, [], "#f4f4f0"), *inner]
    drawn += arrows(reduced(packages), place, core)
    return HEAD.format(height=below + 6 + MARGIN) + "\n".join(drawn) + "\n</svg>\n"


@cache
def imports() -> tuple[Edges, Edges]:
    """Count the imports between packages, and between folders of the core."""
    packages, folders = Edges(), Edges()
    for name, folder in PACKAGES.items():
        for path in sorted(folder.rglob("*.py")):
            own = path.relative_to(folder).parts[0]
            for other, inner in used(path):
                if other in PACKAGES and other != name:
                    packages[name, other] += 1
                elif other == name == CORE and own != inner and (folder / own).is_dir():
                    folders[own, inner] += (folder / inner).is_dir()
    return packages, folders


def used(path: Path) -> Iterator[tuple[str, str]]:
    """Yield package and folder, or module, of what a file imports when it runs."""
    left: list[ast.AST] = [ast.parse(path.read_text(encoding="utf-8"))]
    statements = (ast.stmt, ast.ExceptHandler, ast.match_case)
    while left:
        node = left.pop()
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            left += node.orelse
            continue
        left += [each for each in ast.iter_child_nodes(node) if isinstance(each, statements)]
        names: Iterable[str] = ()
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Import):
            names = [f"{alias.name}." for alias in node.names]
        yield from sorted({(name.split(".")[0], name.split(".")[1]) for name in names})


def levels(edges: Edges) -> dict[str, int]:
    """Return the row of each name, from below: one above the highest that it imports."""
    below: dict[str, set[str]] = {}
    for (name, other), count in edges.items():
        if count > edges[other, name]:
            below.setdefault(name, set()).add(other)
    found: dict[str, int] = {}
    for name in TopologicalSorter(below).static_order():  # raises CycleError
        found[name] = max((found[other] + 1 for other in below.get(name, ())), default=0)
    return found


def rows_of(found: Mapping[str, int]) -> list[list[str]]:
    """Return names by level, the highest first."""
    rows = [
        sorted(name for name in found if found[name] == level)
        for level in range(max(found.values()) + 1)
    ]
    return rows[::-1]


def reduced(edges: Edges) -> Edges:
    """Leave out what others lead along."""

    def leads(begin: str, end: str) -> bool:
        return any(
            name == begin and (other == end or leads(other, end)) for name, other in list(edges)
        )

    return Edges(
        {
            (name, other): count
            for (name, other), count in edges.items()
            if not any(
                begin == name and step != other and leads(step, other) for begin, step in edges
            )
        }
    )


def said_of(folder: Path, width: int) -> list[str]:
    """Return the first line of the docstring of a package, in lines that fit a width."""
    module = ast.parse((folder / "__init__.py").read_text(encoding="utf-8"))
    first = (ast.get_docstring(module) or "").split("\n")[0]
    return wrap(first.replace("`", ""), int(width / 6.3))


def box(
    corner: tuple[int, int], size: tuple[int, int], name: str, said: Iterable[str], fill: str
) -> str:
    """Return a box with its name and what it is for."""
    (x, y), (width, height) = corner, size
    frame = f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="4" fill="{fill}" '
    lines = [text(x + 8, y + 15, name, ' font-weight="bold"')]
    lines += [text(x + 8, y + 31 + LINE * row, line) for row, line in enumerate(said)]
    return "\n".join([f'{frame}stroke="#888"/>', *lines])


def text(x: int, y: int, line: str, style: str = "") -> str:
    """Return one line of text."""
    return f'<text x="{x}" y="{y}"{style}>{escape(line, quote=False)}</text>'


def arrows(edges: Edges, place: Mapping[str, tuple[int, int]], core: int) -> list[str]:
    """Return lines down from a box, across in the gap below it, and down to what it imports.

    Args:
        edges: What is drawn.
        place: Left upper corner of each package but the core.
        core: Upper edge of the core.
    """
    drawn: list[str] = []
    leaving, coming = Counter[str](), Counter[str]()
    for name, other in sorted(edges, key=lambda edge: place.get(edge[1], (0, 0)), reverse=True):
        x, y = place[name]
        x_end, y_end = place.get(other, (x, core))
        straight = x_end == x
        begin = x + BOX // 2 - 24 * leaving[name]
        end = begin if straight else x_end + BOX // 2 + 24 * (1 + coming[other])
        across = y + HEIGHT + 8 + 6 * leaving[name]
        leaving[name] += 1
        coming[other] += not straight
        thick = 0.5 + 0.6 * len(str(edges[name, other]))
        drawn.append(
            f'<path d="M{begin} {y + HEIGHT}V{across}H{end}V{y_end}" fill="none" stroke="#444" '
            f'stroke-width="{thick:.1f}" marker-end="url(#end)"/>'
        )
    return drawn


if __name__ == "__main__":
    main()
