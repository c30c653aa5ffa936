"""Jobs of a recording: what their file may say, where they begin and end, what they count."""

import numpy as np
import pytest

from places import ROOT
from robot_energy.foundation.config_file import validated
from robot_energy.foundation.errors import RegisterError
from robot_energy.replay.api import replay
from robot_energy.replay.recorded_jobs import STEP_NS, JobList, load_jobs

BAG = ROOT / "bags/kr16_cold"
START = 1_000_000_000
JOBS = [("cycle", 0, 9), ("cycle", 9, 18), ("other", 20, 27), ("last", 27, 36)]


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("jobs") / "jobs.yaml"
    rows = [f"- {{name: {n}, begin: {START + a}, end: {START + b}}}\n" for n, a, b in JOBS]
    beyond = f"- {{name: later, begin: {START + 36}, end: {START + 40}}}\n"
    path.write_text("jobs:\n" + "".join(rows) + beyond)
    return replay(BAG, "kr16", jobs=path)


def test_jobs_begin_and_end_where_the_file_says(recording):
    found = recording.report.jobs
    assert [job.name for job in found] == [name for name, _, _ in JOBS]
    for job, (_, begin, end) in zip(found, JOBS, strict=True):
        for stamp, wanted in ((job.start_ns, begin), (job.end_ns, end)):
            assert abs(stamp - (START + wanted) * 10**9) <= STEP_NS + 4_000_000
    assert found[0].end_ns == found[1].start_ns  # nothing is lost in between


def test_the_energy_is_the_integral_of_the_power_between_the_bounds(recording):
    stamp, power = recording.power.stamp_ns, recording.power["predicted_grid_power"]
    for job in recording.report.jobs:
        inside = (stamp >= job.start_ns) & (stamp <= job.end_ns)
        energy = np.trapezoid(power[inside], stamp[inside] * 1e-9)
        assert job.energy == pytest.approx(energy, rel=1e-6)
        assert job.time == pytest.approx((job.end_ns - job.start_ns) * 1e-9)
        assert job.peak_grid_power == pytest.approx(power[inside][1:].max())
        assert job.measured_energy == pytest.approx(job.energy, rel=0.05)


def test_jobs_change_no_other_figure(recording):
    plain = replay(BAG, "kr16")
    assert plain.energy == recording.energy
    assert plain.comparison == recording.comparison
    assert plain.report.jobs == ()


def test_a_job_that_is_not_whole_in_the_recording_is_left_out_and_said(tmp_path):
    path = tmp_path / "jobs.yaml"
    path.write_text(
        f"jobs: [{{name: early, begin: {START - 5}, end: {START + 2}}}, "
        f"{{name: long, begin: {START + 30}, end: {START + 40}}}]"
    )
    found = replay(BAG, "kr16", jobs=path)
    assert found.report.jobs == ()
    assert any(note.endswith("left out: 2") for note in found.notes)


@pytest.mark.parametrize("hours", [-2, 2])
def test_jobs_of_another_time_are_named_with_both_times(hours, tmp_path):
    path = tmp_path / "jobs.yaml"
    begin = START + 3600 * hours
    path.write_text(f"jobs: [{{name: one, begin: {begin}, end: {begin + 9}}}]")
    (note,) = [note for note in replay(BAG, "kr16", jobs=path).notes if "jobs" in note]
    assert "begins 2001-09-09 01:46:40 UTC" in note
    assert f"begins 2001-09-{'08 23' if hours < 0 else '09 03'}:46:40 UTC" in note


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("jobs: [{name: a, begin: 2, end: 1}]", "after the begin"),
        ("jobs: [{name: a, begin: 1, end: 3}, {name: b, begin: 2, end: 4}]", "begins in the job"),
        ("jobs: [{name: a, begin: .nan, end: 3}]", "begin"),
        ("jobs: [{name: '', begin: 1, end: 3}]", "name"),
        ("jobs: [{name: a, begin: 1}]", "end"),
        ("work: []", "jobs"),
    ],
)
def test_a_wrong_list_is_refused_with_its_place(tmp_path, text, said):
    path = tmp_path / "jobs.yaml"
    path.write_text(text)
    with pytest.raises(RegisterError, match=said):
        load_jobs(path)


@pytest.mark.parametrize("name", ["part \udce9", "part \u202e", "part\n1", "  ", "x" * 101])
def test_a_name_that_no_account_keeps_is_refused_with_the_list(name):
    data = {"jobs": [{"name": name, "begin": 1.0, "end": 3.0}]}
    with pytest.raises(RegisterError, match=r"jobs\..*expected"):
        validated(data, JobList, "jobs.yaml", RegisterError)
