"""What a report says, once: sections, tables, figures and remarks, for terminal and page.

`report.printing` writes it to a terminal, `report.html` as one file. A result is not formatted
anywhere else; its JSON is the result itself (`results.base`).
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pkgutil import resolve_name
from typing import Annotated, Any, Literal

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import ReportError
from robot_energy.results.base import Result
from robot_energy_report.formats import NOTHING
from robot_energy_report.page.energy_flow import FlowPicture

Where = Literal["both", "page", "terminal"]
Kind = Literal["plain", "strong", "note", "problem", "command", "h2", "h3", "h4"]
HEADINGS: dict[int, Kind] = {2: "h2", 3: "h3", 4: "h4"}
Draw = Callable[[BytesIO], object]
Rows = Sequence[Sequence[str]]
# What writes the document of a result, by the name of its JSON.
DOCUMENTS = {
    "replay": "robot_energy_report.replay:replay_document",
    "prediction": "robot_energy_report.prediction:prediction_document",
    "shared_bus": "robot_energy_report.optimization:shared_bus_document",
    "optimization": "robot_energy_report.optimization:optimization_document",
    "identification": "robot_energy_report.identify_all:identification_document",
    "model": "robot_energy_report.model:model_document",
    "friction": "robot_energy_report.identification:friction_document",
    "friction_study": "robot_energy_report.identification:study_document",
    "cabinet": "robot_energy_report.identification:cabinet_document",
    "thermal": "robot_energy_report.identification:thermal_document",
    "auxiliary": "robot_energy_report.identification:states_document",
    "drives": "robot_energy_report.drives:drives_document",
    "dynamics": "robot_energy_report.dynamics:dynamics_document",
    "excitation": "robot_energy_report.dynamics:excitation_document",
    "test": "robot_energy_report.evaluation:evaluation_document",
    "advice": "robot_energy_fleet.documents.advice:advice_document",
    "fleet_report": "robot_energy_fleet.documents.fleet:fleet_document",
    "fleet_friction": "robot_energy_fleet.documents.fleet:fleet_friction_document",
}


class Column(Described):
    """What a table shows of each of its rows."""

    name: str
    value: str | int | Callable[[Any], Any]
    form: Annotated[Callable[[Any], str], "The value as text; None is a dash."] = str
    unit: Annotated[str, "Behind the name, in brackets; empty for none."] = ""
    total: Annotated[
        bool | Callable[[Sequence[Any]], Any], "Whether rows are summed, or a function of all rows."
    ] = False
    optional: Annotated[bool, "Whether it is left out where no row has a value."] = False

    @property
    def heading(self) -> str:
        """Name and unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    def cell(self, row: Any) -> str:
        """Return what stands in a row, which has the value as attribute, key or number."""
        return self._text(self._of(row))

    def has_something(self, rows: Sequence[Any]) -> bool:
        """Return whether any of the rows has a value or a text."""
        return any(self._of(row) not in (None, "") for row in rows)

    def sum(self, rows: Sequence[Any]) -> str:
        """Return what stands in the row of sums; a dash where a value is not known."""
        if callable(self.total):
            found = self.total(rows)
            return found if isinstance(found, str) else self._text(found)
        values = [self._of(row) for row in rows]
        return self._text(None if None in values else sum(values)) if self.total else ""

    def _of(self, row: Any) -> Any:
        if callable(self.value):
            return self.value(row)
        if isinstance(self.value, str) and not hasattr(row, "keys"):
            return getattr(row, self.value)
        return row[self.value]

    def _text(self, value: Any) -> str:
        return NOTHING if value is None else self.form(value)


class Text(Described):
    """A heading, a sentence, or a command line that makes what is shown."""

    text: str
    kind: Annotated[Kind, "A note or problem must not be overlooked; commands are for pages."] = (
        "plain"
    )


@dataclass(frozen=True)
class Table:
    """Cells, as many in each row as there are columns; no columns: names and values."""

    title: str
    columns: Sequence[str]
    rows: Rows
    total: Sequence[str] | None = None


@dataclass(frozen=True)
class Illustration:
    """A picture that `draw` writes as SVG, and what is to be seen on it; for pages."""

    draw: Draw
    caption: str


@dataclass(frozen=True)
class Tiles:
    """The few figures that matter most, for pages: name, value and a remark of each."""

    tiles: Sequence[tuple[str, str, str]]


class FlowDiagram(Described):
    """Where energy goes, as the picture of the live page; for pages."""

    picture: Annotated[FlowPicture, "Its flows. [J]"]
    caption: str
    unit: str
    factor: Annotated[float, "What one of it is. [J]"]


Part = Text | Table | Illustration | Tiles | FlowDiagram


class Document:
    """A report that grows from top to bottom: parts, each with where it is shown."""

    def __init__(self, title: str = "", lead: str = "") -> None:
        self.title = title
        self.lead = lead
        self.parts: list[tuple[Where, Part]] = []
        self._where: Where = "both"

    @contextmanager
    def only(self, where: Where) -> Generator[None]:
        """Yield while what is added is for pages or the terminal alone; ``both`` is for either."""
        before, self._where = self._where, where
        try:
            yield
        finally:
            self._where = before

    def add(self, part: Part) -> None:
        """Add a part at the end."""
        self.parts.append((self._where, part))

    def shown(self, where: Where) -> list[Part]:
        """Return the parts that a page or a terminal shows."""
        return [part for place, part in self.parts if place in ("both", where)]

    def heading(self, text: str, depth: int = 2) -> None:
        """Begin a section, or one inside it; pages list those of depth 2 at the top."""
        if depth not in HEADINGS:
            raise ReportError(f"a heading of depth {depth}", f"2 to {max(HEADINGS)}")
        self.paragraph(text, HEADINGS[depth])

    def paragraph(self, text: str = "", kind: Kind = "plain") -> None:
        """Add text; pages set what stands between backticks as code, and leave out no text."""
        self.add(Text(text, kind))

    def note(self, text: str) -> None:
        """Add a sentence that must not be overlooked: a warning, or what is not known."""
        self.paragraph(text, "note")

    def notes(self, texts: Sequence[str]) -> None:
        """Add several of them."""
        for text in texts:
            self.note(text)

    def pairs(self, rows: Sequence[tuple[str, str]]) -> None:
        """Add names and values."""
        self.add(Table("", (), rows))

    def figure(self, draw: Draw, caption: str) -> None:
        """Add a figure; its caption is also read out where it cannot be shown."""
        self.add(Illustration(draw, caption))

    def table(
        self, title: str, columns: Sequence[str], rows: Rows, total: Sequence[str] | None = None
    ) -> None:
        """Add a table, if it has rows: first column and sentences left, numbers right."""
        for row in (*rows, *([total] if total is not None else [])):
            if len(row) != len(columns):
                raise ReportError(
                    f"a row of '{title}' has {len(row)} cells", f"{len(columns)}, one per column"
                )
        if rows:
            self.add(Table(title, columns, rows, total))

    def rows(
        self, title: str, columns: Sequence[Column], rows: Sequence[Any], total: str = ""
    ) -> None:
        """Add a table of objects."""
        columns = [one for one in columns if not one.optional or one.has_something(rows)]
        sums = (total, *(column.sum(rows) for column in columns[1:])) if total and rows else None
        cells = [[column.cell(row) for column in columns] for row in rows]
        self.table(title, [column.heading for column in columns], cells, sums)


def document_of(report: Result, title: str = "", lead: str = "", **words: Any) -> Document:
    """Return all that a result says; further words are those of its document."""
    page = Document(title, lead)
    resolve_name(DOCUMENTS[report.NAME])(report, page, **words)
    return page
