"""Books and their files together: restart, other models, a second monitor, late disks."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event

import pytest

import robots
from accounts import IDENTITY, SECOND, steady
from refusals import refused
from robot_energy.accounting.account import EnergyAccount
from robot_energy.accounting.record import FORMAT_VERSION, AccountRecord, Identity
from robot_energy.foundation.errors import RegisterError
from robot_energy.store.account_store import AccountStore, file_name_of, load_account
from robot_energy.store.slots import SlotPair


def keeper(
    folder: Path, account: EnergyAccount | None = None, name: str = "arm", **changes
) -> AccountStore:
    identity = IDENTITY.model_copy(update=changes)
    slots = SlotPair(folder, name, FORMAT_VERSION, AccountRecord.from_json)
    return AccountStore(account or EnergyAccount(len(identity.joint_names)), identity, slots)


def counted(folder: Path, seconds: float = 10) -> None:
    """Leave ten seconds at 100 W behind."""
    books = keeper(folder)
    books.open()
    books.account.step(steady(0, seconds))
    assert books.close()


def imported(books: AccountStore) -> float:
    return float(books.account.registers.cabinet("grid_import"))


def kinds(books: AccountStore) -> list[str]:
    return [entry.kind for entry in books.account.trace.entries]


def test_books_continue(tmp_path):
    counted(tmp_path)
    books = keeper(tmp_path)
    books.open()
    assert (imported(books), books.loaded, books.trouble) == (1000.0, True, "")
    assert kinds(books) == ["restart"]
    books.account.step(steady(12, 13))
    assert books.checkpoint()
    assert (books.sequence, books.checkpoints) == (2, 1)


def test_nothing_is_kept_without_a_folder():
    books = load_account(EnergyAccount(2), robots.two_link(), None)
    books.open()
    books.require()
    assert not books.checkpoint()
    assert books.folder is None
    assert not books.trouble
    assert not books.close()


def test_another_model_of_the_same_robot_goes_on_with_a_trace(tmp_path):
    counted(tmp_path)
    books = keeper(tmp_path, model_id="m2")
    books.open()
    assert imported(books) == 1000.0
    assert kinds(books) == ["restart", "model_changed"]
    assert books.account.trace.entries[-1].text == "model m1 counted until here, m2 from here"
    assert books.notices == ["the registers of model m1 go on with model m2"]


def test_the_same_joints_in_another_order_keep_their_energies(tmp_path):
    counted(tmp_path)
    books = keeper(tmp_path, joint_names=("elbow", "shoulder"))
    books.open()
    straight = keeper(tmp_path / "none", joint_names=IDENTITY.joint_names)
    straight.account.step(steady(0, 10))
    expected = straight.account.registers.joints("shaft_positive")
    assert expected[0] != expected[1]
    assert list(books.account.registers.joints("shaft_positive")) == list(expected[::-1])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"joint_names": ("shoulder", "wrist")}, "of joints shoulder, elbow, the model has shou"),
        ({"joint_names": ("a", "b", "c")}, "the model has a, b, c"),
        ({"robot_serial": "8"}, "the state is of robot 'arm' '7'"),
    ],
    ids=["joints", "more joints", "serial"],
)
def test_the_state_of_something_else_is_moved_aside(tmp_path, changes, words):
    counted(tmp_path)
    books = keeper(tmp_path, **changes)
    books.open()
    assert imported(books) == 0.0
    assert len(books.notices) == 1
    assert words in books.notices[0]
    assert "moved aside as" in books.notices[0]
    assert [path.name for path in tmp_path.glob("*.bad-1")] == ["arm.a.state.bad-1"]
    assert kinds(books) == ["began_anew"]
    books.account.registers.time.start_ns = None
    assert books.checkpoint()


def test_damaged_files_begin_again_with_a_notice(tmp_path):
    counted(tmp_path)
    for path in tmp_path.glob("*.state"):
        path.write_bytes(b"")
    books = keeper(tmp_path)
    books.open()
    assert kinds(books) == ["file_lost", "began_anew"]
    assert books.notices[-1] == "the registers begin at zero: no state file could be used"
    assert books.account.registers.time.start_ns is None


def test_one_damaged_file_is_noted_in_the_books_that_go_on(tmp_path):
    counted(tmp_path)
    (tmp_path / "arm.b.state").write_bytes(b"rubbish")
    books = keeper(tmp_path)
    books.open()
    assert imported(books) == 1000.0
    assert kinds(books) == ["file_lost", "restart"]


def test_a_second_monitor_writes_nothing_and_takes_over_without_counting_twice(tmp_path):
    first, second = keeper(tmp_path), keeper(tmp_path)
    first.open()
    second.open()
    assert "another monitor" in second.trouble
    assert str(tmp_path) in second.trouble
    with refused(RegisterError, expected="state files"):
        second.require()
    for start in range(4):  # both see the same robot
        block = steady(start, start + 0.99)
        first.account.step(block)
        second.account.step(block)
        assert first.checkpoint()
        assert not second.checkpoint()
    assert second.failures == 5
    assert imported(second) == pytest.approx(399.0)
    second.account.step(steady(4, 5.99))  # the first one no longer sees these
    first.close()
    assert second.checkpoint()
    assert second.trouble == ""
    second.require()
    assert imported(second) == pytest.approx(399.0)
    second.account.step(steady(6, 7))
    assert imported(second) == pytest.approx(499.0)
    time = second.account.registers.time
    assert time.gap_ns == round(2.01 * SECOND)  # since the newest sample of the first
    assert kinds(second) == ["restart"]


def test_a_folder_that_comes_late_loses_nothing(tmp_path):
    """A disk mounted after the start holds older totals: both parts count."""
    real, place = tmp_path / "real", tmp_path / "mounted"
    counted(real)
    place.write_text("not mounted yet")
    books = keeper(place)
    books.open()
    assert "cannot be kept in" in books.trouble
    books.account.step(steady(60, 61))
    assert not books.checkpoint()
    place.unlink()
    real.rename(place)
    assert books.checkpoint()
    assert imported(books) == pytest.approx(1100.0)
    assert books.account.registers.time.gap_ns == 50 * SECOND


def test_a_folder_that_is_removed_is_made_again(tmp_path):
    folder = tmp_path / "state"
    books = keeper(folder)
    books.open()
    books.account.step(steady(0, 1))
    assert books.checkpoint()
    for path in folder.iterdir():
        path.unlink()
    folder.rmdir()
    assert not (books.begin() and books.poll())
    assert str(folder) in books.trouble
    books.account.step(steady(1.01, 2))
    assert books.checkpoint()
    assert books.trouble == ""
    assert imported(books) == 200.0
    books.close()
    again = keeper(folder)
    again.open()
    assert imported(again) == 200.0


def test_slow_disk_does_not_hold_up_the_caller(tmp_path):
    answer = Event()
    with ThreadPoolExecutor(1) as disk:
        try:
            books = keeper(tmp_path)
            books._submit = disk.submit
            books.open()
            disk.submit(answer.wait)  # the disk answers when asked to
            books.account.step(steady(0, 1))
            assert books.begin()
            assert books.poll() is None
            assert books.busy
            assert not books.begin()
            assert not books.checkpoint(patience=0.01)
            assert "has not answered for 0.01 s" in books.trouble
        finally:
            answer.set()
        assert books.checkpoint()
        assert books.trouble == ""


def test_file_names_are_readable_and_differ():
    def name(robot: str, serial: str) -> str:
        return file_name_of(
            Identity(robot_type=robot, robot_serial=serial, joint_names=(), model_id="")
        )

    assert name("KR 16-2", "No. 5").startswith("kr-16-2-no-5-")
    names = {name(*pair) for pair in [("A B", ""), ("a b", ""), ("a", "b"), ("", ""), ("../x", "")]}
    assert len(names) == 5
    assert not any("/" in text or "." in text for text in names)
