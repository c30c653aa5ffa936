"""Two slots: whatever happens to one, the other is used, and nothing is thrown away."""

import os
import re
from pathlib import Path

import pytest

from refusals import refused
from robot_energy.foundation.errors import StateFileError
from robot_energy.store.slots import MAX_ASIDE, SlotPair, unwrap, wrap


def slots(folder: Path) -> SlotPair[bytes]:
    def read(payload: bytes) -> bytes:
        if payload == b"refused":
            raise StateFileError("not a state")
        return payload

    return SlotPair(folder, "arm", 1, read)


def written(folder: Path, *payloads: bytes) -> None:
    pair = slots(folder)
    pair.acquire()
    for payload in payloads:
        pair.write(payload)
    pair.release()


def found(folder: Path):
    pair = slots(folder)
    stored = pair.acquire()
    pair.release()
    return stored


def test_writes_alternate_and_the_newest_is_read(tmp_path):
    for count in range(6):
        stored = found(tmp_path)
        assert stored.sequence == count
        assert stored.value == (f"state {count}".encode() if count else None)
        assert not stored.notices
        written(tmp_path, f"state {count + 1}".encode())
    texts = sorted(path.read_bytes() for path in tmp_path.glob("*.state"))
    assert [text.split(b"\n")[1] for text in texts] == [b"state 5", b"state 6"]


def test_the_folder_is_made(tmp_path):
    written(tmp_path / "a" / "b", b"x")
    assert found(tmp_path / "a" / "b").value == b"x"


def test_a_short_state_over_a_long_one(tmp_path):
    written(tmp_path, b"long " * 100, b"long " * 100, b"short")
    assert found(tmp_path).value == b"short"
    # what a kill between writing and cutting leaves behind
    path = tmp_path / "arm.a.state"
    path.write_bytes(path.read_bytes() + b"long long")
    assert found(tmp_path).value == b"short"


def damage_newest(folder: Path, change) -> bytes:
    """Damage the slot that was written last and return what it now holds."""
    path = folder / "arm.b.state"
    content = change(path.read_bytes())
    path.write_bytes(content)
    return content


def check_damage(folder: Path, change) -> None:
    written(folder, b'{"a": 1}', b'{"a": 2}')
    content = damage_newest(folder, change)
    stored = found(folder)
    assert (stored.value, stored.sequence) == (b'{"a": 1}', 1), content
    assert len(stored.notices) == 1
    assert "moved aside as arm.b.state.bad-1" in stored.notices[0]
    aside = folder / "arm.b.state.bad-1"
    assert aside.read_bytes() == content
    aside.unlink()
    for path in folder.iterdir():
        path.unlink()


SIZE = len(wrap(1, 2, b'{"a": 2}'))


def test_cut_at_every_byte_the_other_slot_is_used(tmp_path):
    for size in range(SIZE):
        check_damage(tmp_path, lambda content, size=size: content[:size])


def flip(content: bytes, bit: int) -> bytes:
    changed = bytearray(content)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def test_every_single_flipped_bit_is_noticed():
    content = wrap(1, 123, b'{"energy_microjoule": 1234567890, "name": "axle"}')
    assert unwrap(1, content)[0] == 123
    for bit in range(8 * len(content)):
        with pytest.raises(StateFileError):
            unwrap(1, flip(content, bit))


def test_with_a_bit_of_any_byte_flipped_the_other_slot_is_used(tmp_path):
    for byte in range(SIZE):
        bit = 8 * byte + byte % 8
        check_damage(tmp_path, lambda content, bit=bit: flip(content, bit))


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"", "an empty file"),
        (wrap(2, 9, b"{}"), "a state file of format 2; expected format 1"),
        (wrap(0, 9, b"{}"), "a state file of format 0; expected format 1"),
        (wrap(1, 9, b"refused"), "not a state"),
        (b"\x00" * 4096, "without the first line"),
        (b"\xff" * 70_000, "without the first line"),
        (wrap(1, 9, b"{}").replace(b"bytes=2", b"bytes=999999999"), "cut after 2 bytes"),
    ],
    ids=["empty", "newer", "older", "unreadable", "zeros", "ones", "length"],
)
def test_a_slot_that_cannot_be_used_is_moved_aside(tmp_path, content, why):
    check_damage(tmp_path, lambda _: content)
    written(tmp_path, b"1", b"2")
    damage_newest(tmp_path, lambda _: content)
    assert re.search(why, found(tmp_path).notices[0])


def test_two_bad_slots_are_both_moved_aside_and_counting_can_begin(tmp_path):
    written(tmp_path, b"1", b"2")
    for path in tmp_path.glob("*.state"):
        path.write_bytes(b"")
    stored = found(tmp_path)
    assert (stored.value, len(stored.notices)) == (None, 2)
    written(tmp_path, b"3")
    assert found(tmp_path).value == b"3"
    assert len(list(tmp_path.glob("*.bad-1"))) == 2


def test_damaged_files_do_not_fill_the_disk(tmp_path):
    for _ in range(MAX_ASIDE + 3):
        written(tmp_path, b"1", b"2")
        damage_newest(tmp_path, lambda _: b"")
        stored = found(tmp_path)
    assert "left in place" in stored.notices[0]
    assert len(list(tmp_path.glob("*.bad-*"))) <= 2 * MAX_ASIDE
    written(tmp_path, b"3")
    assert found(tmp_path).value == b"3"


def test_one_writer(tmp_path):
    first, second = slots(tmp_path), slots(tmp_path)
    first.acquire()
    with refused(StateFileError, found=(f"process {os.getpid()}", str(tmp_path))):
        second.acquire()
    assert not second.held
    first.write(b"1")
    first.release()
    assert second.acquire().value == b"1"
    with refused(StateFileError, remedy="acquire"):
        first.write(b"2")


def test_a_writer_whose_lock_file_was_removed_stops_writing(tmp_path):
    """Someone tidied up, and another process has locked a new file since."""
    first, second = slots(tmp_path), slots(tmp_path)
    first.acquire()
    first.write(b"1")
    (tmp_path / "arm.lock").unlink()
    second.acquire()
    second.write(b"2")
    with refused(StateFileError, found="arm.lock"):
        first.write(b"3")
    assert not first.held
    second.release()
    assert first.acquire().value == b"2"


def test_the_time_of_the_files_does_not_matter(tmp_path):
    written(tmp_path, b"1", b"2")
    for name, when in (("arm.a.state", 4e9), ("arm.b.state", 0)):  # 2096 and 1970
        os.utime(tmp_path / name, (when, when))
    assert found(tmp_path).value == b"2"
