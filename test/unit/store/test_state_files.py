"""Files of a node are its own; what is not a regular file is moved aside, or reported."""

import os
from pathlib import Path

import pytest

import robots
from accounts import SECOND, steady
from robot_energy.accounting.account import EnergyAccount
from robot_energy.store.account_store import AccountStore, file_name_of, load_account

MODEL = robots.two_link()


def keeper(folder: Path, node: str) -> AccountStore:
    return load_account(EnergyAccount(2), MODEL, folder, node=node)


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
