"""Outputs of one command that belong together: a study, and what an identification writes."""

import errno
import os
from argparse import Namespace

import pytest

from faulty_disk import FaultyDisk, inventory
from refusals import refused
from robot_energy.bag import BagWriter
from robot_energy.foundation.errors import ReportError
from robot_energy.foundation.files.output_files import JSON, json_bytes, write_file
from robot_energy.foundation.files.placement import all_or_none
from robot_energy.model import save
from robot_energy_cli.identify_inputs import IdentifyInputs
from robot_energy_cli.terminal import present
from robot_energy_identify.friction.temperature_study import FrictionStudyReport
from robot_energy_papers.cli.reproduce import BAGS, FIGURES, FRONT, MODEL, REPORT, study_folder
from robot_energy_report.canvas import canvas
from robot_energy_report.document import Document
from robot_energy_report.html import write_page
from robots import one_wheel

FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def study(folder, number=1, overwrite=False):
    """What a study writes, in no time."""
    with study_folder(str(folder), overwrite) as place:
        with BagWriter(place / BAGS / "train_00") as bag:
            bag.add_topic("/a", "std_msgs/msg/Float64")
        write_page(Document(f"study {number}"), place / REPORT)
        write_file(place / FIGURES, json_bytes({"number": number}), JSON)
        save(one_wheel(), place / MODEL)
        with canvas(place / FRONT, (1.0, 1.0)) as figure:
            figure.subplots()


def test_a_study_is_replaced_as_a_whole_and_only_if_all_is_ours(tmp_path):
    study(tmp_path / "a")
    before = inventory(tmp_path)
    assert len(before) == 9
    with pytest.raises(ReportError) as caught:
        study(tmp_path / "a", 2)
    assert "--overwrite" in caught.value.remedy
    study(tmp_path / "a", 2, overwrite=True)
    after = inventory(tmp_path)
    assert {name for name in after if after[name] != before[name]} == {
        f"a/{REPORT}", f"a/{FIGURES}"
    }  # fmt: skip
    for foreign in ("notes.txt", f"{BAGS}/own.mcap", f"{BAGS}/train_00/x", "log"):
        path = tmp_path / "a" / foreign
        path.mkdir() if foreign == "log" else path.write_text("mine")
        before = inventory(tmp_path)
        with refused(ReportError, expected="new folder"):
            study(tmp_path / "a", 3, overwrite=True)
        assert inventory(tmp_path) == before
        path.rmdir() if foreign == "log" else path.unlink()


@pytest.mark.parametrize("error", [FULL, KeyboardInterrupt()], ids=["full", "interrupt"])
def test_a_study_that_ends_half_way_leaves_the_old_one(tmp_path, error):
    study(tmp_path / "a")
    before = inventory(tmp_path)
    with pytest.MonkeyPatch.context() as patch:
        disk = FaultyDisk(patch, error, 0, calls=("fsync", "rename", "mkdir"))
        with pytest.raises(ReportError):
            study(tmp_path / "a", 2)  # refused: counts nothing
        study(tmp_path / "b")
        count = disk.count
    for at in range(1, count + 1):
        with pytest.MonkeyPatch.context() as patch:
            FaultyDisk(patch, error, at, calls=("fsync", "rename", "mkdir"))
            with pytest.raises((ReportError, ValueError, KeyboardInterrupt)):
                study(tmp_path / "a", 2, overwrite=True)
        assert {n: v for n, v in inventory(tmp_path).items() if n[0] != "b"} == before, at


def test_results_of_an_identification_appear_together_or_not_at_all(tmp_path, capsys):
    names = {name: str(tmp_path / f"{name}.x") for name in ("out", "json", "report")}
    args = Namespace(**names, bags=[], words=("identify",))

    def write():
        IdentifyInputs(args).check_results()
        with all_or_none():
            save(one_wheel(), args.out)
            present(args, FrictionStudyReport(()), "title")

    for at in (1, 2, 3):
        with pytest.MonkeyPatch.context() as patch:
            FaultyDisk(patch, FULL, at, calls=("replace",))
            with pytest.raises((ReportError, ValueError)):
                write()
        assert inventory(tmp_path) == {}
        assert capsys.readouterr().out == ""  # nothing is claimed to be written
    write()
    assert len(inventory(tmp_path)) == 3
    assert "wrote" in capsys.readouterr().out
