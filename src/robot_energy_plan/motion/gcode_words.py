"""G-code text -> words: one line at a time, nothing guessed, everything bounded.

A word is a letter and a number. Comments stand in ``( )`` or after ``;``; ``N`` numbers a
line; ``*`` ends it with the checksum of the bytes before it (exclusive or), which is
verified. What is neither is refused: readers that skip unknown text turn
``X1.2.3`` into another number and move a robot somewhere else. What stands behind a command of
the machine (``M84 X Y``, ``T0``) may be anything: it is not motion.
"""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from typing import Annotated

from robot_energy.foundation.errors import MotionError

MAX_CHARACTERS = 1000  # of a line
MAX_WORDS = 40  # of a line
WORD = re.compile(r"([A-Za-z])[ \t]*([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))")
COMMENT = re.compile(r"\([^()]*\)")
NUMBER = re.compile(r"[ \t]*[Nn][ \t]*[0-9]+")
EXPONENT = re.compile(r"e[+-]?[0-9]|E[+-][0-9]{2,}(?![0-9]*\.)")  # glued to a number
MESSAGE = re.compile(r"[ \t]*(?:[Nn][ \t]*[0-9]+)?[ \t]*[Mm][ \t]*([0-9]{1,4})(?![0-9.])")
# Commands of the machine; behind G codes of these numbers stand words without a number.
COMMAND = re.compile(
    r"[Mm][ \t]*[0-9]|[Tt][ \t]*(?:[0-9?xc]|$)"
    r"|[Gg][ \t]*(?:10|11|12|27|28|29|3[0-5]|80|380|392)(?![0-9])"
)
MOTION = re.compile(r"(?<![A-Za-z_])[Gg][ \t]*0*[0-3](?![0-9])")
LOOSE = re.compile(
    r"(?<![\w.+-])([A-Za-z])[ \t]*([+-]?(?:[0-9]{1,20}\.?[0-9]{0,20}|\.[0-9]{1,20}))?(?![\w.])"
)
NAMED = re.compile(
    r"[ \t]*(?:[Nn][ \t]*[0-9]+[ \t]*)?([A-Za-z_][A-Za-z_]+[A-Za-z0-9_]*)(?=[ \t]|$)"
)
HOST = re.compile(r"[ \t]*([$@]\w*)")
TEXT_CODES = {20, 21, 23, 28, 29, 30, 32, 33, 36, 117, 118, 486, 928}  # M codes before free text
MAX_DIGITS = 30  # of a number; more are not a measure
QUOTED = 24  # characters of bad text that a message repeats
COMMENT_OR_FEED = re.compile(r"\([^)]*\)|;.*|[Ff]\s*([0-9]*\.?[0-9]+)")
ANY_COMMENT = re.compile(r"\([^)]*\)|;.*")
OTHER_CODE = re.compile(r"[Mm]\s*\d|[Gg]\s*0*(?:10|11|28|29)(?!\d)")
DECIMALS = 3  # of a feed in mm or inch per minute


@dataclass(frozen=True, slots=True)
class Word:
    """A letter and a number."""

    letter: str
    value: Annotated[float, "As written, in the unit of the program."]

    def __str__(self) -> str:
        return f"{self.letter}{self.value:g}"


def words_of(text: str, where: str, printer: bool = True) -> list[Word]:
    """Return the words of a line in order, without line number and checksum.

    The free text of message codes (M117 ...) is left out.

    Args:
        printer: Whether commands of the machine stand alone, with words of any form behind them.
    """
    code = text.partition(";")[0]  # settings of slicers are comments of any length
    if len(code) > MAX_CHARACTERS:
        raise MotionError(
            f"{where} has {len(code)} characters",
            f"at most {MAX_CHARACTERS}",
            "check that this is a G-code file",
        )
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
    try:
        return _strict(bare, where)
    except MotionError:
        if not printer or not COMMAND.match(bare) or MOTION.search(bare):
            raise
    command = WORD.match(bare)
    if command is None:
        return [Word("T", 0.0)]  # a tool without a number
    rest = (
        Word(each[1].upper(), float(each[2] or 0.0))
        for each in LOOSE.finditer(bare, command.end())
        if each[1].upper() not in "GMNT"
    )
    return [Word(command[1].upper(), float(command[2])), *rest]


def _strict(bare: str, where: str) -> list[Word]:
    found: list[Word] = []
    place = 0
    while place < len(bare):
        if bare[place] in " \t":
            place += 1
            continue
        word = WORD.match(bare, place)
        if word is not None and EXPONENT.match(bare, word.end()):
            raise MotionError(
                f"{where}: '{_printable(bare[place:])}' has an exponent, which machines read as "
                "another number",
                "numbers such as -0.001",
                f"write {word[1].upper()} without exponent",
            )
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


def named_command(text: str) -> str | None:
    """Return the name of a command that has one instead of a letter and a number, else None.

    These are the commands and macros of Klipper (``PRINT_START``), those of GRBL (``$H``) and
    those of a printing host (``@OBJECT``).
    """
    code = text.partition(";")[0]
    found = NAMED.match(code) or HOST.match(code)
    return None if found is None else found[1][:QUOTED].upper()


def _checked(code: str, where: str) -> str:
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
    short = text if len(text) <= QUOTED else f"{text[:QUOTED]}..."
    return "".join(c if c.isprintable() else "?" for c in short)


def with_feed(text: str, factor: float) -> str:
    """Return a program whose feeds are all multiplied; G0 without a feed keeps its speed.

    Args:
        factor: > 0. [-]
    """

    def scaled(found: re.Match[str]) -> str:
        if found[1] is None:
            return found[0]
        return f"F{round(float(found[1]) * factor, DECIMALS):.10g}"

    return "".join(
        line
        if named_command(line) or OTHER_CODE.search(ANY_COMMENT.sub("", line))
        else COMMENT_OR_FEED.sub(scaled, line)
        for line in io.StringIO(text, newline="")
    )
