"""Many bags to one dataset, on real Dask workers: whole, resumed, equal to the bit."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import fsspec
import polars as pl
import psutil
import pytest

import robot_energy as re
from histories import HOUR, Robot
from logbook import SPEED, mapping, wheel_bag, wheel_model, wheel_start, write_csv
from places import ROOT
from robot_energy.bag.cdr.decode import RawBatch
from robot_energy.foundation.errors import DatasetError
from robot_energy.messages.fields import ENERGY_REGISTERS
from robot_energy.messages.registers import RegistersWriter
from robot_energy_cli import main
from robot_energy_fleet.bag_list import FleetModels, list_bags
from robot_energy_fleet.bag_row import reading_of, replay_bag
from robot_energy_fleet.dataset import Dataset, read_tables, scan
from robot_energy_fleet.fleet_run import FleetRun, in_turn, on_dask, run_fleet
from robot_energy_history.readings import PHASES, ReadingDecoder
from robot_energy_history.store import HistoryStore
from robot_energy_logs.log_import import import_log

BAG = ROOT / "bags" / "kr16_all_topics"
WARM = ROOT / "bags" / "kr16_warm"
EFFORT = {"effort": "motor_torque"}


def content(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*.parquet")}


def replayed(where, folder, replays=None, progress=lambda done: None):
    """All bags of a place into a dataset, one after the other where nothing else is said."""
    models, dataset = FleetModels(), Dataset(folder)
    bags = list_bags(str(where), models, "kr16", EFFORT)
    done = run_fleet(bags, models.models, dataset, replays or in_turn(), progress=progress)
    dataset.pack()
    return done


@pytest.fixture(scope="module")
def hall(tmp_path_factory):
    """Ten bags of two robots, one of them no bag."""
    folder = tmp_path_factory.mktemp("hall")
    for number in range(9):
        target = folder / f"r{number % 2}" / f"bag{number}"
        target.mkdir(parents=True)
        for file in (WARM if number == 4 else BAG).iterdir():
            # Not a link: links that others make or remove change the time of change of the file.
            shutil.copy(file, target)
    (folder / "r0" / "broken.mcap").write_bytes(b"no bag at all")
    return folder


@pytest.fixture(scope="module")
def sequential(hall, tmp_path_factory):
    folder = tmp_path_factory.mktemp("dataset") / "sequential"
    return folder, replayed(hall, folder)


def workers():
    """The processes that Dask has started."""
    found = []
    for one in psutil.Process().children(recursive=True):
        with suppress(psutil.Error):
            if "spawn_main" in " ".join(one.cmdline()):
                found.append(one)
    return found


@pytest.fixture
def two_cores(monkeypatch):
    """Two of the cores of this process, or the only one, to which it keeps meanwhile."""
    monkeypatch.setattr("robot_energy_fleet.fleet_run.HEAL_EVERY", 0.05)
    every = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(every)[:2])
    yield sorted(every)[:2]
    os.sched_setaffinity(0, every)


def test_workers_that_are_killed_change_no_bit(hall, sequential, tmp_path, two_cores):
    """Each worker has a core of its own, also after a death."""
    killed = []

    def kill(done):
        if done.read == 3 and not killed:
            while not (victims := workers()):
                time.sleep(0.01)  # the processor is for the new worker
            os.kill(victims[done.read % len(victims)].pid, signal.SIGKILL)
            killed.append(done.read)

    def spread():
        with suppress(OSError):  # one may have ended since
            found = [os.sched_getaffinity(one.pid) for one in workers()]
            return sorted(found, key=min) == [{core} for core in two_cores]

    with on_dask(workers=len(two_cores)) as replays:
        done = replayed(hall, tmp_path / "d", replays, kill)
        assert killed
        while not spread():
            time.sleep(0.01)  # the processor is for the new worker
        assert replayed(hall, tmp_path / "again", replays).read == 9
    assert (done.read, len(done.refused)) == (9, 1)
    assert content(tmp_path / "d") == content(sequential[0])
    assert content(tmp_path / "again") == content(sequential[0])


def test_a_history_has_what_the_dataset_has(tmp_path):
    """One bag with two jobs; its tables from either, and a report of the history."""
    recorded = re.replay(WARM, "kr16", **EFFORT).report.time
    begin = recorded.start_ns / 1e9
    jobs = tmp_path / "jobs.yaml"
    spans = ((begin + 1.0, begin + 5.0), (begin + 6.0, begin + 15.0))
    jobs.write_text("jobs:\n" + "".join(
        f"  - {{name: weld, begin: {first!r}, end: {last!r}}}\n" for first, last in spans
    ))  # fmt: skip
    place, kept = tmp_path / "d", tmp_path / "h"
    re.fleet_run(WARM, place, "kr16", workers=0, history=kept, name="a", jobs=jobs, **EFFORT)
    ours, theirs = read_tables(kept), read_tables(place)
    for name in ("runs", "jobs", "hours"):
        one, other = getattr(ours, name), getattr(theirs, name)
        sums = [c for c in one.columns if "_energy" in c or c.endswith(("_time", "_ns"))]
        assert len(one) == len(other) > 0, name
        for column in sums:
            found, expected = one[column].to_list(), other[column].to_list()
            if (name, column) == ("hours", "motion_time"):  # by phase, and by rest of motors
                assert found == pytest.approx(expected, rel=0.02)
            else:
                assert found == expected, (name, column)
        assert len(sums) > 4, name
    assert re.history_jobs(kept, 0, 2**62)["parts"].tolist() == [2]
    report = re.fleet_report(kept)
    assert report.robots[0].grid_energy == pytest.approx(theirs.runs["grid_energy"][0])
    assert report.robots[0].jobs == 2
    assert not any("no recorder" in note for note in report.notes)


def test_energy_before_a_gap_over_an_hour_is_in_its_own_hour(tmp_path):
    """60 s of the wheel at 68 W; 90 minutes are missing, which begin 30 s before an hour."""
    seconds = [number / 20 + (5400.0 if number > 600 else 0.0) for number in range(1201)]
    rows = [(f"{t:.3f}", f"{SPEED * t:.6f}", SPEED) for t in seconds]
    time = {"column": "t", "start": "2024-05-06T06:59:00Z"}
    log = write_csv(tmp_path / "wheel.csv", "t,q_axle,w_axle", rows)
    import_log(log, mapping(time=time, power=None), tmp_path / "bag")
    place, kept, model = tmp_path / "d", tmp_path / "h", wheel_model(tmp_path)
    re.fleet_run(tmp_path / "bag", place, str(model), workers=0, history=kept, name="a")
    hours = read_tables(place).hours
    assert hours["observed_time"].to_list() == pytest.approx([30.0, 30.0], abs=0.2)
    assert hours["grid_energy"].to_list() == pytest.approx([68.0 * 30.0] * 2, rel=0.01)
    recorded = read_tables(kept).hours
    for column in ("hour_ns", "observed_time", "grid_energy"):
        assert hours[column].to_list() == recorded[column].to_list(), column


def test_what_no_hour_of_a_history_holds_is_said(tmp_path):
    store, robot = HistoryStore(tmp_path), Robot()
    store.open()
    store.add("a", [robot.minute(6000) for _ in range(30)])
    robot.advance(2 * HOUR, 6000)
    store.add("a", [robot.minute(6000)])
    assert store.write(robot.now), store.trouble
    store.close()
    report = re.fleet_report(tmp_path)
    assert report.robots[0].grid_energy == 6000 * (151 * 60)
    assert sum(one.grid_energy for one in report.shifts) == 6000 * (30 * 60)
    assert any(note.startswith("12.100 kWh were used while no") for note in report.notes)


@pytest.mark.long
def test_workers_that_die_before_they_are_ready_are_replaced(hall, sequential, tmp_path):
    """Dask alone would wait for ever."""
    seen = set()

    def kill_twice(done):
        if done.read != 2 or seen:
            return
        while len(seen) < 2:
            time.sleep(0.01)  # the processor is for the new worker
            for one in workers():
                if one.pid not in seen:
                    with suppress(psutil.NoSuchProcess):
                        one.send_signal(signal.SIGKILL)
                    seen.add(one.pid)

    with on_dask(workers=1) as replays:
        done = replayed(hall, tmp_path / "d", replays, kill_twice)
    assert len(seen) == 2
    assert done.read == 9
    assert content(tmp_path / "d") == content(sequential[0])


OTHER_USER = """
import os, socket, ssl, sys
from distributed.security import Security
tls = Security.temporary().get_connection_args("client")["ssl_context"]
tls.verify_mode = ssl.CERT_NONE  # who breaks in does not ask whom it talks to
if os.getuid() == 0:
    os.setgroups([]); os.setgid(65534); os.setuid(65534)
for port in map(int, sys.argv[1:]):
    for way, said in (("page", b"GET /info/main/workers.html HTTP/1.0\\r\\n\\r\\n"),
                      ("plain", bytes(64)), ("tls", b"")):
        try:
            with socket.create_connection(("127.0.0.1", port), 60) as own:
                with (tls.wrap_socket(own) if way == "tls" else own) as talk:
                    talk.sendall(said)
                    answer = talk.recv(1000)
        except (ssl.SSLError, ConnectionError):
            answer = b""
        print(os.getuid(), port, way, answer)
        if answer.startswith(b"HTTP"):
            break
"""


def test_another_user_of_this_host_is_refused_by_scheduler_and_workers(hall):
    with on_dask(workers=1) as replays:
        models = FleetModels()
        bags = list_bags(str(hall / "r1" / "bag1"), models, "kr16", EFFORT)
        assert len(list(replays(iter(bags), models.models))) == 1
        ports = {
            one.laddr.port
            for process in (psutil.Process(), *workers())
            for one in process.net_connections("tcp")
            if one.status == psutil.CONN_LISTEN
        }
        words = [sys.executable, "-c", OTHER_USER, *map(str, ports)]
        run = subprocess.run(words, capture_output=True, text=True, check=True)
    found = [line.split(" ", 3) for line in run.stdout.splitlines()]
    if os.getuid() == 0:
        assert {user for user, *_ in found} == {"65534"}
    else:
        print("not root: asked as the same user without the key")
    answers = {(way, answer.partition("\\r")[0]) for *_, way, answer in found}
    assert len(ports) >= 4  # scheduler and worker: for messages, for pages
    assert answers == {
        ("page", "b'HTTP/1.1 404 Not Found"), ("page", "b''"), ("plain", "b''"), ("tls", "b''")
    }  # fmt: skip


def deadly(bag, model, max_scratch):
    """Replay a bag; under one of them the process dies, as one without memory does."""
    if bag.place.address.endswith("bag2"):
        os._exit(1)
    return replay_bag(bag, model, max_scratch)


@pytest.mark.long
def test_a_bag_under_which_workers_die_is_refused_alone(hall, sequential, tmp_path, monkeypatch):
    """Others wait at the same worker each time it dies."""
    monkeypatch.setattr("robot_energy_fleet.fleet_run.replay_bag", deadly)
    monkeypatch.setattr("robot_energy_fleet.fleet_run.ALLOWED_FAILURES", 0)
    with on_dask(workers=1) as replays:
        done = replayed(hall / "r0", tmp_path / "d", replays)
    refused = {Path(address).name: one.reason for (_, address), one in done.refused.items()}
    assert refused.keys() == {"bag2", "broken.mcap"}
    assert "bag2 alone died" in refused["bag2"]
    assert done.read == 4
    monkeypatch.undo()
    assert replayed(hall, tmp_path / "d").read == 5
    assert content(tmp_path / "d") == content(sequential[0])


def test_a_second_run_reads_nothing_and_changes_nothing(hall, sequential):
    folder, first = sequential
    before = content(folder)
    asked = []
    done = replayed(hall, folder, lambda bags, models: (asked.append(bag) for bag in bags))
    assert (first.read, first.there) == (9, 0)
    assert (done.bags, done.there, done.read) == (10, 10, 0)
    assert content(folder) == before
    assert not asked


def test_a_run_that_was_stopped_is_continued(hall, sequential, tmp_path):
    def stop(done):
        if done.read == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        replayed(hall, tmp_path / "d", progress=stop)
    done = replayed(hall, tmp_path / "d")
    assert (done.there, done.read + len(done.refused)) == (5, 5)
    assert content(tmp_path / "d") == content(sequential[0])


@pytest.mark.long
def test_few_bags_are_at_the_scheduler_however_many_there_are(hall, tmp_path, monkeypatch):
    """They are taken from the list as others are finished."""
    taken, most = [], []
    waiting, batch = 8, 4
    for name, value in {"MIN_WAITING": waiting, "PER_THREAD": waiting, "BATCH": batch}.items():
        monkeypatch.setattr(f"robot_energy_fleet.fleet_run.{name}", value)

    def counted(bags, models):
        def listed():
            for bag in bags:
                taken.append(bag)
                yield bag

        with on_dask(workers=1) as replays:
            for place, found in enumerate(replays(listed(), models)):
                most.append(len(taken) - place)
                yield found

    models, dataset = FleetModels(), Dataset(tmp_path / "d")
    one = list_bags(str(hall / "r1"), models, "kr16", {})[0]
    bags = [replace(one, programme=str(number)) for number in range(3 * (waiting + batch))]
    done = run_fleet(bags, models.models, dataset, counted)
    assert done.read == len(bags)
    assert max(most) <= waiting + batch


def test_a_bag_that_cannot_be_used_is_a_row_with_its_reason(hall, sequential):
    runs = scan(sequential[0]).collect()
    row = runs.row(by_predicate=pl.col("reason") != "", named=True)
    assert row["bag"].endswith("broken.mcap")
    assert "no bag at all" in row["reason"]
    assert row["expected"]
    assert row["date"] == "unknown"
    assert row["robot"] == "r0"
    assert len(runs) == 4  # copies of a bag of one robot count once


def test_command_and_function_give_the_same_dataset_and_report(hall, sequential, tmp_path):
    words = ["fleet", "run", str(hall), "--model", "kr16", "--effort", "motor_torque"]
    file = tmp_path / "run.json"
    out = str(tmp_path / "by_command")
    assert main([*words, "--workers", "0", "--out", out, "--json", str(file)]) == 3
    own = re.fleet_run(hall, tmp_path / "own", "kr16", workers=0, effort="motor_torque")
    assert content(tmp_path / "own") == content(tmp_path / "by_command") == content(sequential[0])
    written = json.loads(file.read_text())
    plain = json.loads(json.dumps(own.to_dict()))
    same = plain.keys() - {"dataset", "elapsed_time", "peak_memory"}
    assert {name: written[name] for name in same} == {name: plain[name] for name in same}
    assert (written["bags"], written["replayed"], written["there"]) == (10, 9, 0)
    (refused,) = written["refused"]
    assert (Path(refused["bag"]).name, refused["robot"]) == ("broken.mcap", "r0")
    assert re.fleet_report(tmp_path / "own").bags == 3
    with pytest.raises(TypeError, match="effrot"):
        re.fleet_run(hall, tmp_path / "own", "kr16", effrot="motor_torque")
    with pytest.raises(re.NotIdentifiableError):
        re.fleet_identify(tmp_path / "own", "ur5e")


def test_a_model_in_memory_is_that_of_its_file(hall, tmp_path):
    bag, model = hall / "r1" / "bag1", re.load_model("kr16")
    assert re.fleet_run(bag, tmp_path / "d", model, workers=0).replayed == 1
    assert re.fleet_run(bag, tmp_path / "d", "kr16", workers=0).there == 1
    with pytest.raises(re.NotIdentifiableError, match="no bag of the dataset has measured torque"):
        re.fleet_identify(tmp_path / "d", model)


@pytest.mark.parametrize(
    "words", [{"workers": -1}, {"workers": 10**9}, {"memory": "lots"}, {"memory": "20"}]
)
def test_workers_that_cannot_be_are_refused(words, hall, tmp_path):
    with pytest.raises(re.ParameterError):
        re.fleet_run(hall / "r1" / "bag1", tmp_path / "d", "kr16", **words)


def test_a_reading_of_a_bag_is_what_a_recorder_decodes():
    own = re.replay(WARM, "kr16", effort="motor_torque")
    account, minute_ns = own.replay.account, 7 * 60 * 10**9
    writer = RegistersWriter(own.model.joint_names, own.model.model_id)
    message = writer.encode(account, True, minute_ns)[0].tobytes()
    batch = RawBatch.from_messages("energy/registers", ENERGY_REGISTERS, [0], [message])
    assert ReadingDecoder().decode(batch) == [reading_of(account, own.model, minute_ns)]


def test_registers_are_those_of_a_replay(hall, sequential):
    own = re.replay(WARM, "kr16", effort="motor_torque")
    row = scan(sequential[0]).filter(pl.col("bag").str.contains("bag4")).collect()
    account, phases = own.replay.account, own.report.phases
    assert row["predicted_import_microjoule"][0] == account.registers.microjoule[0]
    assert row["observed_ns"][0] == own.report.time.observed_ns
    for name in PHASES:
        assert row[f"{name}_ns"][0] * 1e-9 == pytest.approx(phases[name].time)
        assert row[f"{name}_microjoule"][0] * 1e-6 == pytest.approx(phases[name].grid_import_energy)
    joints = row["joints"][0]
    friction = [one["friction_microjoule"] * 1e-6 for one in joints]
    assert friction == pytest.approx([j.friction_energy for j in own.joints], abs=2e-6)
    assert {one["joint"] for one in joints} == set(own.model.joint_names)
    errors = row["meter_errors"][0]
    measured = sum(one["measured"] for one in errors)
    error = sum(one["error"] for one in errors)
    assert measured == pytest.approx(own.comparison.measured_energy, rel=1e-9)
    assert error == pytest.approx(own.comparison.predicted_minus_measured_energy, rel=1e-6)


def test_energy_of_a_wheel_is_what_is_worked_out_by_hand(tmp_path):
    """Motor at 20 rad/s with 0.9 N m: 18 W at the shaft, 50 W constant; the meter reads 80 W."""
    bag, model = wheel_bag(tmp_path), wheel_model(tmp_path)
    jobs = tmp_path / "jobs.yaml"
    begin = wheel_start(bag)
    jobs.write_text(f"jobs:\n  - {{name: spin, begin: {begin + 2.0}, end: {begin + 4.0}}}\n")
    out = tmp_path / "d"
    words = ["fleet", "run", str(bag), "--model", str(model), "--out", str(out)]
    assert main([*words, "--workers", "0", "--jobs", str(jobs), "--name", "wheel"]) == 0
    tables = read_tables(out)
    run = tables.runs.row(0, named=True)
    assert run["robot"] == "wheel"
    assert run["grid_energy"] == pytest.approx(68.0 * run["observed_time"], rel=1e-6)
    assert run["observed_time"] == pytest.approx(10.0, abs=0.1)
    job = tables.jobs.row(0, named=True)
    assert job["grid_energy"] == pytest.approx(68.0 * job["observed_time"], rel=1e-6)
    assert job["observed_time"] == pytest.approx(2.0, abs=0.05)
    assert job["measured_energy"] == pytest.approx(
        80.0 / 68.0 * job["predicted_energy_at_meter"], rel=1e-6
    )


def test_a_bag_on_another_file_system_gives_the_same_figures(sequential, tmp_path):
    system = fsspec.filesystem("memory")
    for file in WARM.iterdir():
        system.pipe(f"/far/r9/warm/{file.name}", file.read_bytes())
    try:
        done = replayed("memory://far", tmp_path / "d")
        small = replayed("memory://far", tmp_path / "small", in_turn(max_scratch=1000))
    finally:
        system.rm("/far", recursive=True)
    assert (done.read, small.read) == (1, 0)
    assert "GB" in next(iter(small.refused.values())).reason
    far, near = scan(tmp_path / "d").collect(), scan(sequential[0]).collect()
    near = near.filter(pl.col("bag").str.contains("bag4"))
    own = {"name", "key", "bag", "robot"}
    assert far.drop(own).to_dicts() == near.drop(own).to_dicts()


def still_runs(process, pause=0.01):
    """Whether a process runs; waits for its end meanwhile, so that it has the processor."""
    with suppress(subprocess.TimeoutExpired):
        process.wait(pause)
    return process.returncode is None


@pytest.fixture
def scheduler(tmp_path):
    """A scheduler and two workers, as `howto_fleet.md` starts them on three hosts."""
    file = tmp_path / "scheduler.json"
    dask = [sys.executable, "-m", "dask"]
    where = ["--scheduler-file", str(file), "--dashboard-address", "127.0.0.1:0"]
    worker = ["worker", "--nworkers", "1", "--nthreads", "1", "--memory-limit", "2GB"]
    commands = [["scheduler", "--host", "127.0.0.1", "--port", "0"], worker, worker]
    processes = [
        subprocess.Popen(
            [*dask, *words, *where],
            cwd=tmp_path,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        for words in commands
    ]
    try:
        address = ""
        while not address:  # until the file is there, and complete
            assert all(still_runs(process) for process in processes)
            with suppress(OSError, ValueError):
                address = json.loads(file.read_text())["address"]
        yield address, processes[0]
    finally:
        for process in processes:  # with its own children: without a scheduler they never end
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


@pytest.mark.long
def test_workers_of_another_command_give_the_same_bits_until_their_scheduler_is_lost(
    hall, sequential, tmp_path, scheduler, monkeypatch
):
    """What was done before it was lost stays."""
    monkeypatch.setattr("robot_energy_fleet.fleet_run.TIMEOUT", "1s")  # to come back
    address, process = scheduler

    def killed(done):
        process.kill()

    with on_dask(address) as replays:
        done = replayed(hall, tmp_path / "all", replays)
    with pytest.raises(DatasetError, match="scheduler was lost"), on_dask(address) as replays:
        replayed(hall, tmp_path / "d", replays, killed)
    assert (done.read, len(done.refused)) == (9, 1)
    assert content(tmp_path / "all") == content(sequential[0])
    assert 1 <= len(list((tmp_path / "d").rglob("*.parquet"))) < 10
    replayed(hall, tmp_path / "d")
    assert content(tmp_path / "d") == content(sequential[0])


def test_a_scheduler_that_does_not_answer_is_said(tmp_path, monkeypatch):
    monkeypatch.setattr("robot_energy_fleet.fleet_run.TIMEOUT", "1s")
    with pytest.raises(DatasetError, match="does not answer"), on_dask("tcp://127.0.0.1:1"):
        pass


def test_a_changed_bag_takes_the_place_of_its_row(tmp_path):
    shutil.copytree(WARM, tmp_path / "hall" / "r1" / "bag")
    replayed(tmp_path / "hall", tmp_path / "d")
    (file,) = (tmp_path / "hall" / "r1" / "bag").glob("*.mcap")
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) * 3 // 4])
    done = replayed(tmp_path / "hall", tmp_path / "d")
    assert (done.there, done.read) == (0, 1)
    (row,) = scan(tmp_path / "d").collect().to_dicts()
    assert row["problems"]


def test_a_folder_that_grows_is_taken_in_as_it_comes(tmp_path):
    """A file that is being written is left until it is complete."""
    hall, out = tmp_path / "hall", tmp_path / "d"
    whole = (BAG / "kr16_all_topics_0.mcap").read_bytes()
    (hall / "r1").mkdir(parents=True)
    words = ["fleet", "run", hall, "--model", "kr16", "--out", out, "--workers", "0"]
    command = [sys.executable, "-m", "robot_energy", *map(str, words), "--watch", "0.05"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            (hall / "r1" / "first.mcap").write_bytes(whole)
            growing = hall / "r1" / "growing.mcap"
            growing.write_bytes(whole[:-20])
            wait_for_rows(process, out, 1)
            (hall / "r1" / "third.mcap").write_bytes(whole + b"")
            wait_for_rows(process, out, 2)
            assert not any("growing" in name for name in addresses(out))
            growing.write_bytes(whole)
            wait_for_rows(process, out, 3)
        finally:
            process.send_signal(signal.SIGINT)
        _, problems = process.communicate()
    assert process.returncode == 130, problems
    assert [Path(name).name for name in addresses(out)] == [
        "first.mcap",
        "growing.mcap",
        "third.mcap",
    ]


def addresses(folder):
    files = sorted(folder.glob("robot=*/date=*/*.parquet"))
    return sorted(pl.read_parquet(file, hive_partitioning=False)["bag"][0] for file in files)


def wait_for_rows(process, folder, count):
    """Until the dataset holds so many rows; the command must run meanwhile."""
    while len(list(folder.glob("robot=*/date=*/*.parquet"))) < count:
        assert still_runs(process), process.communicate()


def test_the_command_says_what_was_done(tmp_path, capsys):
    hall = tmp_path / "hall"
    shutil.copytree(BAG, hall / "r1" / "bag")
    (hall / "r1" / "broken.mcap").write_bytes(b"x")
    words = ["fleet", "run", str(hall), "--model", "kr16", "--out", str(tmp_path / "d")]
    assert main([*words, "--workers", "0"]) == 3
    said = capsys.readouterr().out
    assert "2 bags: 1 replayed, 0 there already, 1 refused" in said
    assert "recorded hours" in said
    assert "1 refused: BAG" in said
    assert main(words) == 0  # starts no worker
    assert "2 bags: 0 replayed, 2 there already" in capsys.readouterr().out
    assert FleetRun().read == 0
