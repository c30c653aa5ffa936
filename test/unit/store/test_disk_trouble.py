"""Disks in trouble, on real file systems: counting goes on in memory and recovers.

Each case runs in a process of its own, which may limit its files or mount file systems
that nobody else sees.
"""

import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from places import ROOT

HERE = ROOT / "test"
MOUNTS = ["unshare", "--mount"]  # needs root, as in a container
CAN_MOUNT = (
    subprocess.run(
        [*MOUNTS, "mount", "-t", "tmpfs", "none", "/mnt"], capture_output=True, check=False
    ).returncode
    == 0
)
needs_mounts = pytest.mark.skipif(not CAN_MOUNT, reason="this user may not mount file systems")

BEGIN = """
import os, resource, subprocess, sys
from pathlib import Path
sys.path[:0] = [{here!r}, {source!r}]
from accounts import IDENTITY, steady
from robot_energy.accounting.account import EnergyAccount
from robot_energy.accounting.record import FORMAT_VERSION, AccountRecord
from robot_energy.store.account_store import AccountStore
from robot_energy.store.slots import SlotPair

folder = Path({folder!r})

def new_store():
    slots = SlotPair(folder, "arm", FORMAT_VERSION, AccountRecord.from_json)
    return AccountStore(EnergyAccount(2), IDENTITY, slots)

def command(*words):
    subprocess.run(words, check=True)

def imported(store):
    return round(store.account.registers.cabinet("grid_import"), 6)

def fails(store, *words):
    assert not store.checkpoint()
    for word in words:
        assert word in store.trouble, store.trouble

def recovers(store):
    assert store.checkpoint() and not store.trouble
    total = imported(store)
    store.close()
    again = new_store()
    again.open()
    assert imported(again) == total > 0
    assert not again.notices, again.notices

def one_good_second():
    store = new_store()
    store.open()
    store.account.step(steady(0, 1))
    assert store.checkpoint()
    return store
"""


def run(folder: Path, script: str, *prefix: str) -> None:
    """Run a script in its own process, where it may limit itself and mount."""
    source = HERE.parent / "src"
    begin = BEGIN.format(here=str(HERE), source=str(source), folder=str(folder))
    done = subprocess.run(
        [*prefix, sys.executable, "-c", begin + textwrap.dedent(script)],
        capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


@needs_mounts
def test_disk_full(tmp_path):
    """A tmpfs of 64 kB, filled to the last byte once the first slot exists."""
    folder = tmp_path / "state"
    folder.mkdir()
    run(
        folder,
        """
        command("mount", "-t", "tmpfs", "-o", "size=64k", "none", str(folder))
        store = one_good_second()
        with open(folder / "filler", "wb", buffering=0) as filler:
            try:
                while True:
                    filler.write(bytes(100))
            except OSError:
                pass
        for second in range(1, 4):
            store.account.step(steady(second + 0.01, second + 1))
            fails(store, "No space left on device", str(folder))
        assert store.failures == 3 and imported(store) == 400.0
        (folder / "filler").unlink()
        recovers(store)
        """,
        *MOUNTS,
    )


@needs_mounts
def test_read_only_disk(tmp_path):
    """Made read-only while running, and read-only from the start."""
    folder = tmp_path / "state"
    folder.mkdir()
    run(
        folder,
        """
        store = one_good_second()
        command("mount", "--bind", str(folder), str(folder))
        command("mount", "-o", "remount,bind,ro", str(folder))
        store.account.step(steady(1.01, 2))
        fails(store, "Read-only file system", str(folder))
        fails(store, "Read-only file system")
        store.close()
        started = new_store()
        started.open()
        assert started.loaded and imported(started) == 100.0  # the totals that are on disk
        started.account.step(steady(3, 4))
        fails(started, "Read-only file system")
        assert imported(started) == 200.0
        command("umount", "--lazy", str(folder))
        recovers(started)
        """,
        *MOUNTS,
    )


@needs_mounts
def test_no_permission():
    """A folder that its user may only read."""
    run(
        Path("/mnt/state"),
        """
        command("mount", "-t", "tmpfs", "none", "/mnt")
        folder.mkdir(mode=0o755)
        os.seteuid(65534)  # nobody; root could write anywhere
        store = new_store()
        store.open()
        store.account.step(steady(0, 1))
        fails(store, "Permission denied", str(folder))
        os.seteuid(0)
        folder.chmod(0o777)
        os.seteuid(65534)
        recovers(store)
        """,
        *MOUNTS,
    )


def test_file_size_limit(tmp_path):
    """Writes that break off in the middle (RLIMIT_FSIZE): the slot before stays good."""
    run(
        tmp_path,
        """
        store = one_good_second()
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (500, hard))
        store.account.step(steady(1.01, 2))
        fails(store, "File too large", str(folder))
        assert (folder / "arm.b.state").stat().st_size == 500
        other = new_store()
        store._slots.release()
        other.open()
        assert imported(other) == 100.0  # from the good slot
        assert "cut after" in other.notices[0]
        other.close()
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        recovers(store)
        """,
    )


def test_a_file_where_the_folder_should_be(tmp_path):
    run(
        tmp_path / "state",
        """
        folder.write_text("in the way")
        store = new_store()
        store.open()
        store.account.step(steady(0, 1))
        fails(store, str(folder), "a folder that can be written")
        folder.unlink()
        recovers(store)
        """,
    )
