"""Files of an earlier release, named by robot alone: adopted once, whatever interrupts it."""

import fcntl
import os
from pathlib import Path

import pytest

import robots
from accounts import SECOND, steady
from robot_energy.accounting.account import EnergyAccount
from robot_energy.store.account_store import AccountStore, file_name_of, identity_of, load_account

MODEL = robots.two_link()
EARLIER = file_name_of(identity_of(MODEL))


def keeper(folder: Path, node: str) -> AccountStore:
    return load_account(EnergyAccount(2), MODEL, folder, node=node)


def earlier_files(folder: Path) -> None:
    """Leave 1000 J behind, as a release did that knew no node."""
    books = keeper(folder, "")
    books.open()
    books.account.step(steady(0, 5))
    assert books.checkpoint()
    books.account.step(steady(5.01, 10))
    assert books.close()
    assert len(list(folder.glob(f"{EARLIER}.*.state"))) == 2


def imported(books: AccountStore) -> float:
    return round(books.account.registers.cabinet("grid_import"), 6)


def test_two_namespaces_never_share(tmp_path):
    first, second = keeper(tmp_path, "/cell1/em"), keeper(tmp_path, "/cell2/em")
    for books, watt in ((first, 100.0), (second, 50.0)):
        books.open()
        books.account.step(steady(0, 10, watt=watt))
    assert first.checkpoint()
    assert second.checkpoint()
    assert first.close()
    assert second.close()
    for node, energy in (("/cell1/em", 1000.0), ("/cell2/em", 500.0), ("/cell3/em", 0.0)):
        books = keeper(tmp_path, node)
        books.open()
        assert (imported(books), books.trouble) == (energy, "")


def test_the_first_node_adopts_and_no_other_ever(tmp_path):
    earlier_files(tmp_path)
    first = keeper(tmp_path, "/cell1/em")
    first.open()
    assert imported(first) == 1000.0
    assert "/cell1/em" in first.adopted
    assert not first.notices
    assert [entry.kind for entry in first.account.trace.entries] == ["restart", "adopted"]
    assert first.close()
    second = keeper(tmp_path, "/cell2/em")
    second.open()
    assert (imported(second), second.adopted) == (0.0, "")
    earlier_files(tmp_path)  # the earlier release runs once more
    for node, energy in (("/cell1/em", 1000.0), ("/cell3/em", 0.0)):
        again = keeper(tmp_path, node)
        again.open()
        assert (imported(again), again.adopted) == (energy, "")
        assert again.close()
    for own in tmp_path.glob(f"{file_name_of(identity_of(MODEL, '/cell1/em'))}.*.state"):
        own.unlink()  # somebody begins again
    again = keeper(tmp_path, "/cell1/em")
    again.open()
    assert (imported(again), again.adopted) == (0.0, "")


def test_registers_that_count_already_adopt_nothing(tmp_path):
    own = keeper(tmp_path, "/em")
    own.open()
    own.account.step(steady(0, 1))
    assert own.close()
    earlier_files(tmp_path)
    own = keeper(tmp_path, "/em")
    own.open()
    assert (imported(own), own.adopted) == (100.0, "")


def test_a_finished_adoption_never_replaces_what_was_counted_since(tmp_path):
    """A slot was taken, the process killed, and the earlier release writes once more."""
    own = keeper(tmp_path, "/em")
    own.open()
    own.account.step(steady(0, 1))
    assert own.checkpoint()
    own.account.step(steady(1.01, 2))
    assert own.close()
    earlier_files(tmp_path)
    (tmp_path / f"{EARLIER}.adopted").write_text("begun /em\n")
    own = keeper(tmp_path, "/em")
    own.open()
    assert (imported(own), own.adopted) == (200.0, "")


def test_what_an_earlier_release_still_writes_is_left_to_it(tmp_path):
    earlier_files(tmp_path)
    with (tmp_path / f"{EARLIER}.lock").open("a") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        books = keeper(tmp_path, "/em")
        books.open()
        assert (imported(books), books.trouble, books.adopted) == (0.0, "", "")
    assert len(list(tmp_path.glob(f"{EARLIER}.*.state"))) == 2


class Killed(BaseException):
    """The process has ended here."""


@pytest.mark.parametrize("other_first", [False, True])
def test_killed_at_any_step_nothing_is_lost_and_nothing_counts_twice(
    tmp_path, monkeypatch, other_first
):
    """Before and after each change of the folder: exactly one node has the energy."""
    completed = False
    for stop in range(100):
        folder = tmp_path / str(stop)
        earlier_files(folder)
        left = [stop]

        def counted(name, left=left):
            real = getattr(os, name)

            def call(*args, **options):
                for _ in ("before", "after"):
                    if left[0] == 0:
                        raise Killed
                    left[0] -= 1
                    if _ == "before":
                        result = real(*args, **options)
                return result

            return call

        with monkeypatch.context() as patch:
            for name in ("rename", "unlink", "fsync"):
                patch.setattr(os, name, counted(name))
            books = keeper(folder, "/em")
            try:
                books.open()
                completed = True
            except Killed:
                pass
            books._slots.release()
        nodes = ("/other", "/em") if other_first else ("/em", "/other")
        found = {}
        for node in nodes:
            next_one = keeper(folder, node)
            next_one.open()
            found[node] = imported(next_one)
            assert next_one.close()
            assert not next_one.notices
        assert sorted(found.values()) == [0.0, 1000.0], (stop, found)
        if completed:
            break
    assert completed
    assert stop > 8


@pytest.mark.parametrize("kind", ["link", "pipe", "folder"])
@pytest.mark.parametrize("which", ["a.state", "b.state"])
def test_a_slot_that_is_no_file_is_moved_aside(tmp_path, kind, which):
    folder, victim = tmp_path / "state", tmp_path / "victim"
    victim.write_text("precious")
    books = keeper(folder, "/em")
    books.open()
    books.account.step(steady(0, 1))
    assert books.checkpoint()
    assert books.checkpoint()
    place = folder / f"{file_name_of(books._identity)}.{which}"
    place.unlink()
    {
        "link": lambda: place.symlink_to(victim),
        "pipe": lambda: os.mkfifo(place),
        "folder": place.mkdir,
    }[kind]()
    books.account.step(steady(1.01, 2))
    for _ in range(4):  # it is met, moved aside, written
        books.checkpoint()
    assert (books.trouble, imported(books)) == ("", 200.0)
    assert books.close()
    assert place.is_file()
    assert not place.is_symlink()
    assert victim.read_text() == "precious"


@pytest.mark.parametrize("kind", ["link", "pipe", "folder"])
def test_a_lock_that_is_no_file_is_trouble_and_left_alone(tmp_path, kind):
    folder, victim = tmp_path / "state", tmp_path / "victim"
    victim.write_text("precious")
    folder.mkdir()
    books = keeper(folder, "/em")
    lock = folder / f"{file_name_of(books._identity)}.lock"
    {
        "link": lambda: lock.symlink_to(victim),
        "pipe": lambda: os.mkfifo(lock),
        "folder": lock.mkdir,
    }[kind]()
    books.account.step(steady(0, 1))
    assert not books.checkpoint()
    assert "regular file" in books.trouble
    assert victim.read_text() == "precious"
    lock.rmdir() if kind == "folder" else lock.unlink()
    assert books.checkpoint()


def test_a_folder_that_is_a_link_is_used(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "state").symlink_to(tmp_path / "real")
    books = keeper(tmp_path / "state", "/em")
    books.account.step(steady(0, 1))
    assert books.checkpoint()
    assert list((tmp_path / "real").glob("*.state"))
    assert books.account.registers.time.observed_ns == SECOND
