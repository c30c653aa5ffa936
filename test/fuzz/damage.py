"""Edits of valid samples, by numbers that a generator draws."""

from collections.abc import Iterable

KINDS = ("flip", "put", "cut", "repeat", "number", "splice")
MAX_VALUE = 2**32 - 1
NUMBERS = [b"nan", b"inf", b"-1", b"0", b"1e308", b"1e400", b"9" * 20, b"~", b"[", b"{"]
WORDS = [b"\x00" * 8, b"\xff" * 8, b"\xff\xff\xff\x7f", bytes.fromhex("000000000000f07f"),
         bytes.fromhex("000000000000f87f"), bytes.fromhex("a0c8eb85f3cce17f")]  # fmt: skip


def damaged(seed: bytes, edits: Iterable[tuple[str, float, int]]) -> bytes:
    """A valid sample after some edits: kind, place as a share of its length, value."""
    data = bytearray(seed)
    for kind, share, value in edits:
        place = int(share * len(data))
        if kind == "flip" and data:
            data[min(place, len(data) - 1)] ^= 1 << value % 8
        elif kind == "put":
            word = WORDS[value % len(WORDS)]
            data[place : place + len(word)] = word
        elif kind == "cut":
            del data[place : place + value % 64]
        elif kind == "repeat":
            data[place:place] = data[place : place + value % 64]
        elif kind == "number":
            data[place : place + value % 5] = NUMBERS[value % len(NUMBERS)]
        elif kind == "splice":
            other = value % (len(data) + 1)
            data[place : place + 16] = data[other : other + 16]
    return bytes(data)
