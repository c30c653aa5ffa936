"""The one writer: whole or not at all, and never over what is not ours."""

import errno
import gc
import os
import signal
import subprocess
import sys
import threading

import pytest

from faulty_disk import FaultyDisk, inventory
from refusals import refused
from robot_energy.foundation.errors import ReportError
from robot_energy.foundation.files.output_files import (
    HTML,
    HTML_MARK,
    JSON,
    check_file,
    json_bytes,
    write_file,
)
from robot_energy.foundation.files.output_folder import OutputFolder, check_folder
from robot_energy.foundation.files.placement import PREFIX, all_or_none, deferred_signals, place_all

OLD, NEW = json_bytes({"a": 1}), json_bytes({"a": 2})
PAGE = f"<!DOCTYPE html>{HTML_MARK}".encode()
FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def nothing_foreign(folder):
    """Folders of these tests hold files with our mark only."""
    return [path.name for path in folder.iterdir() if path.read_bytes() not in (OLD, NEW)]


def write_three(folder):
    """Two files and a folder, together."""
    with all_or_none():
        write_file(folder / "a.json", NEW, JSON)
        made = OutputFolder(folder / "deep" / "bag", nothing_foreign, overwrite=True)
        try:
            with made.open("x") as file:
                file.write(NEW)
            made.place()
        except OSError as error:
            made.discard()
            raise made.failure(error) from error
        except BaseException:
            made.discard()
            raise
        write_file(folder / "b.json", NEW, JSON)


def three(folder, data):
    (folder / "deep" / "bag").mkdir(parents=True, exist_ok=True)
    for name in ("a.json", "deep/bag/x", "b.json"):
        (folder / name).write_bytes(data)


@pytest.mark.parametrize("start", ["nothing", "old"])
@pytest.mark.parametrize("done", [False, True], ids=["before", "after"])
@pytest.mark.parametrize("error", [FULL, KeyboardInterrupt()], ids=["full", "interrupt"])
def test_a_fault_at_any_file_operation_leaves_all_or_nothing(tmp_path, start, done, error):
    wanted = tmp_path / "wanted"
    wanted.mkdir()
    three(wanted, NEW)
    after = inventory(wanted)
    at, met = 0, True
    while met:
        at += 1
        folder = tmp_path / f"{at}"
        folder.mkdir()
        if start == "old":
            three(folder, OLD)
        before = inventory(folder)
        with pytest.MonkeyPatch.context() as patch:
            disk = FaultyDisk(patch, error, at, done)
            try:
                write_three(folder)
                raised = None
            except (ReportError, KeyboardInterrupt) as found:
                raised = found
            met = disk.met
        found = inventory(folder)
        if raised is None:
            assert found == after
        elif isinstance(raised, ReportError):
            assert found == before, at
            assert str(folder) in str(raised)
        else:
            assert found in (before, after), at
    assert at > 20


def test_a_second_output_that_is_refused_takes_the_first_with_it(tmp_path):
    def write():
        with all_or_none():
            write_file(tmp_path / "a.json", NEW, JSON)
            (tmp_path / "b.json").write_text("mine")  # while the command works
            write_file(tmp_path / "b.json", NEW, JSON)

    with pytest.raises(ReportError):
        write()
    assert [path.name for path in tmp_path.iterdir()] == ["b.json"]
    assert (tmp_path / "b.json").read_text() == "mine"


def test_what_appears_while_the_command_works_is_not_replaced(tmp_path):
    def write():
        with all_or_none():
            write_file(tmp_path / "a.json", NEW, JSON)
            (tmp_path / "a.json").write_text("mine")

    with pytest.raises(ReportError):
        write()
    assert inventory(tmp_path).keys() == {"a.json"}
    assert (tmp_path / "a.json").read_text() == "mine"


def test_outputs_can_be_placed_before_the_block_ends(tmp_path):
    def write():
        with all_or_none():
            write_file(tmp_path / "a.json", NEW, JSON)
            place_all()
            assert (tmp_path / "a.json").read_bytes() == NEW
            write_file(tmp_path / "b.json", NEW, JSON)
            raise BrokenPipeError

    with pytest.raises(BrokenPipeError):
        write()
    assert inventory(tmp_path).keys() == {"a.json"}


@pytest.mark.parametrize("kinds", [JSON, HTML])
def test_only_a_file_of_the_same_kind_is_replaced(tmp_path, kinds):
    target = tmp_path / "x"
    for held in (OLD, PAGE, b'{"a": 1}', b"\0" * 10_000, b"#!/bin/sh\n"):
        target.write_bytes(held)
        if (held == OLD and kinds is JSON) or (held == PAGE and kinds is HTML):
            check_file(target, kinds)
            continue
        with pytest.raises(ReportError) as caught:
            write_file(target, NEW, kinds)
        assert "overwrite" not in caught.value.remedy  # it would not help
        assert target.read_bytes() == held


def test_an_empty_file_is_filled_and_keeps_its_mode(tmp_path):
    target = tmp_path / "x"
    target.touch(0o600)
    target.chmod(0o640)
    write_file(target, NEW, JSON)
    assert target.read_bytes() == NEW
    assert target.stat().st_mode & 0o777 == 0o640


def test_links_folders_and_names_that_no_file_has(tmp_path):
    (tmp_path / "real").write_bytes(OLD)
    (tmp_path / "link").symlink_to("real")
    (tmp_path / "nowhere").symlink_to("none")
    (tmp_path / "folder").mkdir()
    names = ["link", "nowhere", "folder", "no/x", "real/x", "a\0b", "n" * 300, "\ud800"]
    before = inventory(tmp_path)
    for name in names:
        with pytest.raises(ReportError):
            write_file(f"{tmp_path}/{name}", NEW, JSON)
        with pytest.raises(ReportError):
            check_file(f"{tmp_path}/{name}" if name != "n" * 300 else "no/x", JSON)
    for name in ("link", "nowhere", "real", "a\0b", "\ud800"):
        with pytest.raises(ReportError):
            OutputFolder(f"{tmp_path}/{name}", nothing_foreign, overwrite=True)
    with pytest.raises(ReportError):
        check_folder("/", nothing_foreign, overwrite=True)
    with pytest.raises(ReportError):
        write_file("", NEW, JSON)
    assert inventory(tmp_path) == before


def test_a_link_is_refused_with_what_to_give_in_its_place(tmp_path):
    """As /dev/stdout is one, where the standard output is a file."""
    (tmp_path / "there").mkdir()
    with (tmp_path / "file").open("wb") as stream:
        (tmp_path / "stdout").symlink_to(f"/dev/fd/{stream.fileno()}")
        for write in (check_file, lambda path, kinds: write_file(path, NEW, kinds)):
            with refused(ReportError, found="a link", remedy=("file that it leads to", "give -")):
                write(tmp_path / "stdout", JSON)
            with refused(ReportError, found="a folder", remedy="a file in it"):
                write(tmp_path / "there", JSON)
    check_file(tmp_path / "file", JSON)


def test_inputs_are_known_by_their_files_and_not_by_their_names(tmp_path):
    bag = tmp_path / "day" / "bag"
    bag.mkdir(parents=True)
    (bag / "x").write_bytes(OLD)
    (tmp_path / "link").symlink_to(bag / "x")
    (tmp_path / "twin").hardlink_to(bag / "x")
    (tmp_path / "around").symlink_to(tmp_path / "day")
    for source in (bag / "x", tmp_path / "link", tmp_path / "twin", bag, tmp_path / "around/bag"):
        for file in (bag / "x", bag / ".." / "bag" / "x"):
            with pytest.raises(ReportError, match="the input"):
                check_file(file, JSON, inputs=[source])
        for folder in (bag, tmp_path / "around" / "bag"):
            with pytest.raises(ReportError, match="the input"):
                check_folder(folder, nothing_foreign, overwrite=True, inputs=[source])
    for inside in (bag / "new", bag / "deep" / "new"):
        with pytest.raises(ReportError, match="the input"):
            check_folder(inside, nothing_foreign, inputs=[bag])
    with pytest.raises(ReportError, match="the input"):  # an input inside of the output
        check_folder(tmp_path / "day", lambda _: [], overwrite=True, inputs=[bag / "x"])
    check_file(tmp_path / "day" / "r.json", JSON, inputs=[bag, "kr16", tmp_path / "none"])
    check_folder(tmp_path / "new", nothing_foreign, inputs=[bag])


def test_a_folder_with_anything_else_is_never_replaced(tmp_path):
    folder = tmp_path / "bag"
    folder.mkdir()
    check_folder(folder, nothing_foreign)  # an empty one holds nothing to lose
    (folder / "x").write_bytes(OLD)
    with pytest.raises(ReportError) as caught:
        check_folder(folder, nothing_foreign)
    assert "--overwrite" in caught.value.remedy
    check_folder(folder, nothing_foreign, overwrite=True)
    (folder / "thesis").write_text("dear")
    for overwrite in (False, True):
        with pytest.raises(ReportError) as caught:
            check_folder(folder, nothing_foreign, overwrite)
        assert "--overwrite" not in caught.value.remedy  # it would not help


def test_a_file_added_at_the_last_moment_keeps_the_folder(tmp_path):
    made = OutputFolder(tmp_path / "bag", nothing_foreign, overwrite=True)
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "thesis").write_text("dear")
    with pytest.raises(ReportError):
        made.place()
    assert inventory(tmp_path).keys() == {"bag", "bag/thesis"}


def test_devices_and_pipes_are_written_to(tmp_path):
    write_file("/dev/null", NEW, JSON)
    assert not os.path.isfile("/dev/null")
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    read = []
    reader = threading.Thread(target=lambda: read.append(pipe.read_bytes()), daemon=True)
    reader.start()
    write_file(pipe, NEW, JSON)
    reader.join()
    assert read == [NEW]
    assert pipe.is_fifo()
    with pytest.raises(ReportError, match="No space"):
        write_file("/dev/full", NEW, JSON)


def test_drafts_of_killed_runs_go_and_those_of_running_ones_stay(tmp_path):
    code = (
        "import os, signal, sys\n"
        "from robot_energy.foundation.files.output_folder import OutputFolder\n"
        "made = OutputFolder(sys.argv[1], lambda _: [])\n"
        "made.open('x').close()\n"
        "print('ready', flush=True)\n"
        "sys.stdin.read()\n"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "bag")]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(command, **pipes) as running:
        assert running.stdout.readline() == b"ready\n"
        other = OutputFolder(tmp_path / "bag", nothing_foreign)
        assert sum(name.startswith(PREFIX) for name in os.listdir(tmp_path)) == 2
        other.discard()
        running.send_signal(signal.SIGKILL)
        running.wait()
    (draft,) = os.listdir(tmp_path)
    assert draft.startswith(PREFIX)
    OutputFolder(tmp_path / "other", nothing_foreign).discard()  # another target leaves it alone
    assert os.listdir(tmp_path) == [draft]
    old = draft.replace(".new", ".old")  # as if killed between the two renames
    os.rename(tmp_path / draft, tmp_path / old)
    with refused(ReportError, remedy="--overwrite"):
        OutputFolder(tmp_path / "bag", lambda _: [])
    assert os.listdir(tmp_path) == ["bag"]  # what was set aside is back
    (tmp_path / draft).mkdir()
    OutputFolder(tmp_path / "bag", lambda _: [], overwrite=True).discard()
    assert os.listdir(tmp_path) == ["bag"]


def test_a_draft_that_is_forgotten_goes(tmp_path):
    OutputFolder(tmp_path / "bag", nothing_foreign)
    gc.collect()
    assert os.listdir(tmp_path) == []


def test_signals_wait_for_the_end_of_what_must_not_be_cut(request):
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored under nohup
    request.addfinalizer(lambda: signal.signal(signal.SIGINT, before))
    steps = []

    def stop():
        with deferred_signals():
            signal.raise_signal(signal.SIGINT)
            steps.append("done")

    with pytest.raises(KeyboardInterrupt):
        stop()
    assert steps == ["done"]
