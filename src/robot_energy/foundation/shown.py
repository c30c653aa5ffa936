"""What results and models show of themselves in a notebook; the companion for reports draws it."""

from __future__ import annotations

from importlib import import_module
from typing import Any


class Shown:
    """Draws itself on axes of matplotlib, and is a page of its own in a notebook."""

    def plot(self, what: str | None = None, axes: Any = None) -> Any:
        """Draw one aspect.

        Args:
            what: ``power``, ``energy``, ``parts`` (where the energy goes), ``joints`` or
                ``temperatures`` of a replay or a prediction; ``friction`` (over temperature)
                of a model or an identification; None: the first of those that it has.
            axes: Axes of matplotlib to draw on; None: a new figure.

        Returns:
            The axes.

        Raises:
            ReportError: If this cannot be drawn of it.
            MissingExtraError: If matplotlib is not installed.
        """
        return import_module("robot_energy_report.notebook").plot(self, what, axes)

    def _repr_html_(self) -> str:
        return import_module("robot_energy_report.notebook").html(self)
