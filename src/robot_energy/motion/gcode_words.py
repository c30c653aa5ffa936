"""G-code text -> words: one line at a time, nothing guessed, everything bounded.

A word is a letter and a number. Comments stand in ``( )`` or after ``;``; ``N`` numbers a
line; ``*`` ends it with the checksum of the bytes before it (exclusive or), which is
verified. What is neither is refused: readers that skip unknown text turn
``X1.2.3`` into another number and move a robot somewhere else.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from robot_energy.errors import MotionError

MAX_CHARACTERS = 1000  # of a line
MAX_WORDS = 40  # of a line
WORD = re.compile(r"([A-Za-z])[ \t]*([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))")
COMMENT = re.compile(r"\([^()]*\)")
NUMBER = re.compile(r"[ \t]*[Nn][ \t]*[0-9]+")
MESSAGE = re.compile(r"[ \t]*(?:[Nn][ \t]*[0-9]+)?[ \t]*[Mm][ \t]*([0-9]{1,4})(?![0-9.])")
TEXT_CODES = {20, 21, 23, 28, 29, 30, 32, 33, 36, 117, 118, 486, 928}  # M codes before free text
MAX_DIGITS = 30  # of a number; more are no measure
QUOTED = 24  # characters of bad text that a message repeats
COMMENT_OR_FEED = re.compile(r"\([^)]*\)|;.*|[Ff]\s*([0-9]*\.?[0-9]+)")
ANY_COMMENT = re.compile(r"\([^)]*\)|;.*")
OTHER_CODE = re.compile(r"[Mm]\s*\d|[Gg]\s*0*(?:10|11|28|29)(?!\d)")
DECIMALS = 3  # of a feed in mm or inch per minute


@dataclass(frozen=True, slots=True)
class Word:
    """A letter and a number.

    Attributes:
        letter: Capital.
        value: As written, in the unit of the program.
    """

    letter: str
    value: float

    def __str__(self) -> str:
        return f"{self.letter}{self.value:g}"


def words_of(text: str, where: str) -> list[Word]:
    """Return the words of a line in order, without line number and checksum.

    The free text of message codes (M117 ...) is left out.

    Args:
        text: One line, without its end.
        where: File and line, for messages.

    Raises:
        MotionError: If a part is not a word, a comment does not end, or a checksum is wrong.
    """
    if len(text) > MAX_CHARACTERS:
        raise MotionError(
            f"{where} has {len(text)} characters",
            f"at most {MAX_CHARACTERS}",
            "check that this is a G-code file",
        )
    code = text.partition(";")[0]
    if (message := MESSAGE.match(code)) is not None and int(message[1]) in TEXT_CODES:
        return [Word("M", float(message[1]))]
    code = _checked(code, where) if "*" in code else code
    bare = COMMENT.sub(" ", code)
    for mark in "()":
        if mark in bare:
            raise MotionError(f"{where} has a '{mark}' without its partner", "comments in ( )")
    bare = bare.strip()
    if bare in ("", "%"):
        return []
    if (number := NUMBER.match(bare)) is not None:
        bare = bare[number.end() :].strip()
    found: list[Word] = []
    place = 0
    while place < len(bare):
        if bare[place] in " \t":
            place += 1
            continue
        word = WORD.match(bare, place)
        after = "" if word is None else bare[word.end() : word.end() + 1]
        if word is None or after == "." or len(word[2]) > MAX_DIGITS:
            raise MotionError(
                f"{where}: '{_printable(bare[place:])}' is not a word of G-code",
                "a letter and a number, such as X12.5",
                "give comments in ( ) or after ;",
            )
        letter, value = word[1].upper(), float(word[2])
        found.append(Word(letter, value))
        if len(found) > MAX_WORDS:
            raise MotionError(f"{where} has more than {MAX_WORDS} words", "fewer")
        place = word.end()
    return found


def _checked(code: str, where: str) -> str:
    """Verify and remove a checksum."""
    body, _, given = code.partition("*")
    given = given.strip()
    actual = 0
    for byte in body.encode("utf-8", "replace"):
        actual ^= byte
    if not (given.isascii() and given.isdigit()) or len(given) > 3 or int(given) != actual:
        raise MotionError(
            f"{where} has the checksum '{_printable(given)}'",
            f"{actual}, which is that of its text",
            "the file was damaged or edited; write it again or remove the checksums",
        )
    return body


def _printable(text: str) -> str:
    """The beginning of a text, for messages."""
    short = text if len(text) <= QUOTED else f"{text[:QUOTED]}..."
    return "".join(c if c.isprintable() else "?" for c in short)


def with_feed(text: str, factor: float) -> str:
    """Return a program whose feeds are all multiplied; G0 without a feed keeps its speed.

    Args:
        text: G-code.
        factor: > 0. [-]
    """

    def scaled(found: re.Match[str]) -> str:
        if found[1] is None:
            return found[0]
        return f"F{round(float(found[1]) * factor, DECIMALS):.10g}"

    return "".join(
        line if OTHER_CODE.search(ANY_COMMENT.sub("", line)) else COMMENT_OR_FEED.sub(scaled, line)
        for line in text.splitlines(keepends=True)
    )
