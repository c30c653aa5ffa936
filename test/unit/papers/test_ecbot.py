"""Total power of real cobots: what is held out, and what is compared."""

import os
from pathlib import Path

import pytest

from places import ROOT
from robot_energy.foundation.errors import ReportError
from robot_energy.foundation.files.temporary_folder import TemporaryFolder
from robot_energy_cli.main import main
from robot_energy_identify.drives.drive_data import drive_data_of_logs
from robot_energy_identify.drives.total_power import held_out_powers
from robot_energy_identify.drives.total_sums import sums
from robot_energy_logs.log_import import contents_of, open_logs
from robot_energy_logs.mapping import load_mapping
from robot_energy_papers.job_pool import StudyRun
from robot_energy_studies.ecbot import ECBOT_TEST, WITHOUT, data_folder, study

DATA = os.environ.get("ROBOT_ENERGY_DATA", "")
needs_data = pytest.mark.skipif(not DATA, reason="skipped: no data folder (ROBOT_ENERGY_DATA)")


@pytest.fixture(scope="module")
def robots():
    with TemporaryFolder() as folder:
        return study(StudyRun(folder.path, 0), Path(DATA))


@needs_data
def test_real_robots_are_predicted_by_fits_that_have_not_seen_them(robots):
    ur3e, cobot = robots
    assert ur3e.rms < ECBOT_TEST[0] < ECBOT_TEST[1] < cobot.rms
    for robot in robots:
        assert robot.train_rms < robot.rms < 0.3 * robot.constant_rms
        assert robot.of_spread < 0.25
        assert all(abs(one.energy_error) < 0.06 for one in robot.recordings)
    assert ur3e.recordings[2].energy_per_metre == pytest.approx(
        ur3e.recordings[2].mean_power * 1.4 / ur3e.recordings[2].tool_path
    )
    assert cobot.recordings[0].energy_per_metre is None


@needs_data
def test_the_same_figure_as_identification_says(robots):
    mapping = load_mapping(ROOT / "src/examples/mappings/voraus.yaml")
    logs = open_logs([str(Path(DATA) / "voraus" / "test.parquet")], mapping)
    data = drive_data_of_logs(
        [(contents_of(logs, mapping), [log.whole()]) for log in logs], "newton_metre"
    )
    held_out = held_out_powers(sums(data, None), None)
    scores = held_out.scores()
    assert held_out.kind == "recordings"
    assert robots[1].rms == pytest.approx(scores["identified"].rms, rel=1e-9)
    assert robots[1].constant_rms == pytest.approx(scores["constant"].rms, rel=1e-9)


@needs_data
def test_what_is_left_out_has_no_power_of_the_robot():
    for folder in WITHOUT:
        for file in (Path(DATA) / folder).glob("*.csv"):
            header = file.read_bytes()[:5000].split(b"\n")[0].decode("latin-1").lower()
            assert "power" not in header
            assert "voltage" not in header


@needs_data
def test_the_command_writes_its_page(tmp_path, capsys):
    out = tmp_path / "ecbot"
    assert main(["reproduce", "ecbot", "--out", str(out)]) == 0
    assert "1.45 to 5.25 W" in capsys.readouterr().out
    assert "no positions" in (out / "report.html").read_text()


def test_a_folder_without_recordings_is_refused(tmp_path, monkeypatch):
    monkeypatch.delenv("ROBOT_ENERGY_DATA", raising=False)
    with pytest.raises(ReportError, match="rad_ur3e"):
        data_folder(str(tmp_path))
    with pytest.raises(ReportError, match="--data or ROBOT_ENERGY_DATA"):
        data_folder()
