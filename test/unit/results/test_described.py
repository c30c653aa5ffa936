"""Docstrings of results and rows: one section, a line for each field that has a text."""

from collections.abc import Iterator
from typing import Annotated

import robot_energy_papers.sensitivity  # noqa: F401  results with fields of their own
from robot_energy.foundation.described import Described


class Motor(Described):
    """A motor."""

    power: Annotated[float, "At the shaft. [W]"]
    name: str


class Geared(Motor):
    """A motor with a gear."""

    ratio: Annotated[float, "Of the gear. [-]"] = 1.0


def classes_of(kind: type) -> Iterator[type]:
    for one in kind.__subclasses__():
        yield one
        yield from classes_of(one)


def test_the_fields_of_a_base_are_there_and_those_without_a_text_are_not():
    assert Geared.__doc__ == (
        "A motor with a gear.\n\nAttributes:\n    power: At the shaft. [W]\n"
        "    ratio: Of the gear. [-]"
    )


def test_no_class_has_two_sections_or_an_empty_line_for_a_field():
    texts = [str(one.__doc__) for one in classes_of(Described)]
    assert len(texts) > 20
    assert [text for text in texts if text.count("Attributes:") > 1 or ": \n" in f"{text}\n"] == []
