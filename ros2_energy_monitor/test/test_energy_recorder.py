# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The recorder next to real monitors: its sums are the registers, whatever happens to it."""

from __future__ import annotations

import os
import shutil
import struct
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import closing
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.serialization import serialize_message
from ros2_energy_msgs.msg import (
    EnergyRegisters,
    FrictionCondition,
    JointCondition,
    JointEnergy,
    PowerState,
)
from ros2_energy_msgs.srv import CloseInterval, OpenInterval

from robot_energy.foundation.errors import HistoryError
from robot_energy_history.api import history, history_events, history_friction
from robot_energy_history.check import check
from robot_energy_history.database import open_reader
from robot_energy_history.store import HistoryStore
from ros2_energy_monitor.base.publishers import latched, reliable
from ros2_energy_monitor.base.reader_memory import OF_THE_FOLDER, VARIABLE, make_room_as_needed
from ros2_energy_monitor.nodes import energy_recorder
from ros2_energy_monitor.nodes.energy_dashboard import EnergyDashboard
from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor
from ros2_energy_monitor.nodes.energy_recorder import EnergyRecorder
from ros2_energy_monitor.nodes.virtual_robot import VirtualRobot
from ros2_energy_monitor.recorder import recorded_robot

IMPORT = "predicted_import_microjoule"
QUICK = {"take_period": 0.2, "write_period": 1.0, "look_period": 1.0, "min_free": 0}
SECOND = 10**9


def total(folder: Any, name: str = IMPORT) -> int:
    """What the history holds; 0 before there is one."""
    try:
        reader = open_reader(folder)
    except HistoryError:
        return 0
    with closing(reader) as connection:
        return connection.execute(f"SELECT coalesce(sum({name}), 0) FROM slot15").fetchone()[0]


def registers(second: int, watt: int = 100) -> EnergyRegisters:
    """The registers of a robot that draws a power since second 0, at a second."""
    message = EnergyRegisters(model_id="m1", observed_ns=second * SECOND)
    message.header.stamp.sec = 1_700_000_000 + second
    message.energy_start.sec = 1_700_000_000
    message.predicted_import_microjoule = message.phase_microjoule[2] = second * watt * 10**6
    message.phase_ns[2] = second * SECOND
    message.joints = [JointEnergy(name="a", friction_microjoule=second * 10**6)]
    return message


@pytest.fixture
def publish(bench: Any) -> Callable[..., None]:
    publishers: dict[str, Any] = {}

    def send(topic: str, *messages: EnergyRegisters) -> None:
        if topic not in publishers:
            publishers[topic] = bench.tester.create_publisher(
                EnergyRegisters, topic, reliable(1000)
            )
        publisher = publishers[topic]
        bench.spin_until(lambda: publisher.get_subscription_count() > 0, "the recorder")
        for message in messages:
            publisher.publish(message)

    return send


def test_a_monitor_its_jobs_and_its_registers(bench: Any, tmp_path: Any) -> None:
    bench.add(VirtualRobot)
    monitor = bench.add(EnergyMonitor, model="kr16", state_folder=str(tmp_path / "state"))
    recorder = bench.add(EnergyRecorder, folder=str(tmp_path / "h"), **QUICK)
    for kind, name in ((OpenInterval, "open"), (CloseInterval, "close")):
        client = bench.tester.create_client(kind, f"/energy_monitor/{name}_interval")
        bench.spin_until(lambda client=client: client.service_is_ready(), name)
        bench.spin_until(lambda: monitor.account.end_ns is not None, "samples")
        answer = client.call_async(kind.Request(name="part 7"))
        bench.spin_until(answer.done, name)
        assert answer.result().success, answer.result().message
    monitor.trigger_deactivate()
    bench.spin_until(lambda: not recorder.store.trouble and recorder.store.waiting, "readings")
    last = monitor.account.totals()

    def recorded() -> bool:
        recorder.take()
        recorder._finish(lambda: recorder._written(newest=True))
        return total(tmp_path / "h") == last.cabinet_energy_microjoule["grid_import"]

    bench.spin_until(recorded, "the registers")
    assert total(tmp_path / "h", "brake_microjoule") == last.cabinet_energy_microjoule["brake"]
    assert total(tmp_path / "h", "observed_ns") == last.observed_ns
    assert check(tmp_path / "h") == []

    def jobs() -> list[Any]:
        with closing(open_reader(tmp_path / "h")) as connection:
            return connection.execute("SELECT name FROM job").fetchall()

    bench.spin_until(jobs, "the job")
    assert jobs() == [("part 7",)]


def test_robots_are_missed_once_they_were_looked_for(bench: Any, tmp_path: Any) -> None:
    """They are found up to 20 s after the start, and their registers taken 20 s later."""
    diagnosed, name = bench.diagnosed(), "energy_recorder: history"
    patient = bench.add(EnergyRecorder, folder=str(tmp_path / "a"), min_free=0)
    assert diagnosed.wait(name, "looks for robots").level == DiagnosticStatus.OK
    bench.remove(patient)
    bench.add(EnergyRecorder, folder=str(tmp_path / "b"), **QUICK)
    diagnosed.wait(name, "start a monitor: no energy/registers is published")


def test_robots_are_found_by_their_namespaces(bench: Any, publish: Any, tmp_path: Any) -> None:
    recorder = bench.add(EnergyRecorder, folder=str(tmp_path), **QUICK)
    topics = ("/left/energy/registers", "/right/energy/registers", "/energy/registers")
    for topic in topics:
        bench.tester.create_publisher(EnergyRegisters, topic, reliable(10))
    for number, topic in enumerate(topics, 1):
        publish(topic, registers(60 * number))
    bench.spin_until(lambda: recorder.store.waiting == 3, "three readings")
    recorder.trigger_deactivate()
    found = history(tmp_path, 0, 2**62, "all")
    used = {name: second * 100 * 10**6 for name, second in
            (("left", 60), ("right", 120), ("robot", 180))}  # fmt: skip
    assert dict(zip(found["robot"].tolist(), found[IMPORT].tolist(), strict=True)) == used


@pytest.mark.parametrize("node", [EnergyRecorder, EnergyDashboard])
def test_a_robot_that_has_the_name_of_another_is_said(bench: Any, tmp_path: Any, node, capfd):
    """One without a namespace is called robot, and so is that of the namespace /robot."""
    bench.tester.create_publisher(EnergyRegisters, "/energy/registers", reliable(10))
    bench.tester.create_publisher(EnergyRegisters, "/robot/energy/registers", reliable(10))
    bench.tester.create_publisher(PowerState, "/energy/power", reliable(10))
    bench.tester.create_publisher(PowerState, "/robot/energy/power", reliable(10))
    if node is EnergyRecorder:
        bench.add(node, folder=str(tmp_path), **QUICK)
    else:
        bench.add(node, port=0, history_folder="none")
    said: list[str] = []
    word = "recorded" if node is EnergyRecorder else "shown"
    words = f"as that of the namespace /robot: one of them is not {word}; give the first"
    bench.spin_until(lambda: said.append(capfd.readouterr().err) or words in "".join(said), words)


def test_a_full_disk_is_said_and_survived(
    bench: Any, publish: Any, tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    diagnosed = bench.diagnosed()
    bench.add(EnergyRecorder, folder=str(tmp_path), **{**QUICK, "min_free": 1})
    publish("/energy/registers", registers(60))
    bench.spin_until(lambda: total(tmp_path) > 0, "the first reading")
    real = shutil.disk_usage
    monkeypatch.setattr(shutil, "disk_usage", lambda path: real(path)._replace(free=0))
    diagnosed.wait("energy_recorder: history", "0 MB of free space")
    publish("/energy/registers", registers(300))
    before = total(tmp_path)
    monkeypatch.undo()
    bench.spin_until(lambda: total(tmp_path) > before, "the second reading")
    diagnosed.wait_anew("energy_recorder: history", "all is well")
    assert total(tmp_path) == 300 * 100 * 10**6


def test_a_disk_that_hangs_is_said_and_stops_no_taking(
    bench: Any, publish: Any, tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The check of the space hangs, as of a share that does not answer."""
    monkeypatch.setattr(energy_recorder, "LATE", 0.5)
    diagnosed = bench.diagnosed()
    recorder = bench.add(EnergyRecorder, folder=str(tmp_path), **QUICK)
    bench.spin_until(lambda: recorder.store.commits, "the file")
    free, real = threading.Event(), shutil.disk_usage
    monkeypatch.setattr(shutil, "disk_usage", lambda path: (free.wait(60), real(path))[1])
    publish("/energy/registers", registers(60))
    diagnosed.wait("energy_recorder: history", "a write has been under way")
    publish("/energy/registers", registers(180), registers(300))
    bench.spin_until(lambda: recorder.store.waiting >= 3, "what waits")
    assert total(tmp_path) == 0
    free.set()
    bench.spin_until(lambda: total(tmp_path) == 300 * 100 * 10**6, "all of it")
    assert check(tmp_path) == []


def test_alarms_and_restarts_are_events(
    bench: Any, publish: Any, tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorded_robot, "LASTING", 0.3)
    monkeypatch.setattr(recorded_robot, "OVER", 0.3)
    monkeypatch.setattr(energy_recorder, "STATUS_PERIOD", 0.1)
    recorder = bench.add(EnergyRecorder, folder=str(tmp_path), **QUICK)
    publish("/left/energy/registers", registers(60))
    bench.spin_until(lambda: recorder.store.robots == ("left",), "the robot")
    statuses = bench.tester.create_publisher(DiagnosticArray, "/diagnostics", 10)

    def until(kind: str, level: bytes, restarts: int) -> None:
        message = DiagnosticArray()
        message.header.stamp.sec = 1_700_000_100
        for name in ("left/energy_monitor", "right/energy_monitor", "energy_monitor"):
            message.status.append(
                DiagnosticStatus(name=f"{name}: registers", level=level, message="no disk",
                                 values=[KeyValue(key="restarts", value=str(restarts))])
            )  # fmt: skip

        def noted() -> bool:
            statuses.publish(message)
            found = history_events(tmp_path, 0, 2**62)
            return kind in found["kind"].tolist()

        bench.spin_until(noted, kind)

    until("alarm", DiagnosticStatus.ERROR, 3)
    until("alarm_ended", DiagnosticStatus.OK, 3)
    until("restart", DiagnosticStatus.OK, 4)
    found = history_events(tmp_path, 0, 2**62)
    assert found["robot"].tolist() == ["left"] * 4
    texts = dict(zip(found["kind"].tolist(), found["text"].tolist(), strict=True))
    assert texts["alarm"] == "energy_monitor: registers: error: no disk"
    assert texts["restart"] == "energy_monitor was started again"


def test_learned_friction_is_kept_but_for_that_of_a_recording(
    bench: Any, publish: Any, tmp_path: Any
) -> None:
    recorder = bench.add(EnergyRecorder, folder=str(tmp_path), **QUICK)
    learned = bench.tester.create_publisher(FrictionCondition, "/left/energy/condition", latched(1))

    def learn(day: int, ratio: float) -> None:
        message = FrictionCondition(model_id="m1")
        message.header.stamp.sec = 1_700_000_000 + 86_400 * day
        message.joints = [
            JointCondition(name="a", multiplier=ratio, valid=True),
            JointCondition(name="b", multiplier=1.0, valid=False),
            JointCondition(name="c", multiplier=float("nan"), valid=True),
        ]
        learned.publish(message)

    def ratios() -> list[float]:
        return history_friction(tmp_path, 0, 2**62, "day")["ratio"].tolist()

    publish("/left/energy/registers", registers(60))
    bench.spin_until(lambda: recorder.store.robots == ("left",), "the robot")
    learn(0, 1.25)
    bench.spin_until(lambda: ratios() == [1.25], "what was learned")
    played = registers(120)
    played.header.frame_id = "recording"
    publish("/left/energy/registers", played)
    robot = recorder._robots["left"]
    bench.spin_until(lambda: robot.played, "the recording")
    learn(1, 1.5)
    bench.spin_until(lambda: robot._condition.received > 1, "what a recording taught")
    publish("/left/energy/registers", registers(180))
    bench.spin_until(lambda: not robot._recording, "the robot again")
    learn(2, 1.75)
    bench.spin_until(lambda: len(ratios()) == 2, "what was learned later")
    found = history_friction(tmp_path, 0, 2**62, "day")
    assert found["ratio"].tolist() == [1.25, 1.75]
    assert set(found["joint"].tolist()) == {"a"}


def test_heads_of_statuses_are_those_of_the_message() -> None:
    message = DiagnosticArray()
    message.header.stamp.sec, message.header.frame_id = 12, "abc"
    message.header.stamp.nanosec = 34
    for number, text in enumerate(("", "a", "Gr\u00f6\u00dfe", "x" * 300)):
        values = [KeyValue(key=f"k{one}", value=text) for one in range(number)]
        message.status.append(
            DiagnosticStatus(level=bytes([number]), name=f"n{text}: s", message=text,
                             hardware_id=text[:3], values=values)
        )  # fmt: skip
    message.status[2].values.append(KeyValue(key="restarts", value="7"))
    data = serialize_message(message)
    stamp_ns, heads = recorded_robot.status_heads(data)
    assert stamp_ns == 12 * SECOND + 34
    assert [(one.name, one.level, one.message) for one in heads] == [
        (one.name, one.level, one.message) for one in message.status
    ]
    assert [one.restarts for one in heads] == ["", "", "7", ""]
    for length in range(len(data) - 3):  # up to three bytes fill the last word
        with pytest.raises((ValueError, struct.error, IndexError)):
            recorded_robot.status_heads(data[:length])


def test_an_alarm_is_noted_once_it_lasts_and_one_that_comes_again_is_the_same() -> None:
    watch = recorded_robot.AlarmWatch("/left/")
    ok, bad = (
        [recorded_robot.StatusHead("left/energy_monitor: energy", level, "odd")]
        for level in (DiagnosticStatus.OK, DiagnosticStatus.WARN)
    )
    kinds = []
    for second, status in enumerate([bad] * 5 + [ok] * 5 + [bad] * 30 + [ok] * 30 + [bad] * 30
                                    + [ok] * 100):  # fmt: skip
        kinds += [(second, one.kind) for one in watch.take(status, 0, float(second))]
    assert kinds == [(20, "alarm"), (160, "alarm_ended")]


def test_a_folder_that_cannot_be_used_is_said_and_taken_once_it_can(
    bench: Any, publish: Any, tmp_path: Any
) -> None:
    diagnosed = bench.diagnosed()
    place = tmp_path / "place"
    place.write_text("a file where a folder should be")
    bench.add(EnergyRecorder, folder=str(place / "h"), **QUICK)
    diagnosed.wait("energy_recorder: history", "cannot be written")
    publish("/energy/registers", registers(60))
    place.unlink()
    bench.spin_until(lambda: total(place / "h"), "it")
    assert total(place / "h") == 60 * 100 * 10**6


def test_a_second_recorder_says_so_and_takes_over(bench: Any, publish: Any, tmp_path: Any) -> None:
    diagnosed = bench.diagnosed()
    first = HistoryStore(tmp_path)
    first.open()
    bench.add(EnergyRecorder, folder=str(tmp_path), **QUICK)
    diagnosed.wait("energy_recorder: history", "writes the history")
    publish("/energy/registers", registers(60))
    assert total(tmp_path) == 0
    first.close()
    bench.spin_until(lambda: total(tmp_path) > 0, "the reading")
    assert total(tmp_path) == 60 * 100 * 10**6


def test_a_life_cycle_loses_nothing(bench: Any, publish: Any, tmp_path: Any) -> None:
    recorder = bench.add(EnergyRecorder, folder=str(tmp_path), autostart=False, **QUICK)
    assert recorder.state == "unconfigured"
    for round_ in range(1, 4):
        recorder.trigger_configure()
        recorder.trigger_activate()
        publish("/energy/registers", registers(60 * round_))
        bench.spin_until(lambda: recorder.store.waiting or recorder.store.ignored, "a reading")
        recorder.trigger_deactivate()
        assert total(tmp_path) == 60 * round_ * 100 * 10**6
        recorder.trigger_cleanup()
        assert recorder.store is None
    HistoryStore(tmp_path).open()  # the lock is free


def test_a_recorder_imports_neither_the_model_nor_what_reports_need():
    code = "import sys, ros2_energy_monitor.nodes.energy_recorder; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.partition(".")[0] for name in run.stdout.split()}
    assert "sqlite3" in loaded
    assert not loaded & {"pinocchio", "pydantic", "polars", "scipy", "matplotlib", "rich"}


MEMORY = """
import sys
from ros2_energy_monitor.base.reader_memory import make_room_as_needed
if sys.argv[1] == "as needed":
    make_room_as_needed()
import rclpy
from ros2_energy_msgs.msg import EnergyRegisters

def private():
    with open("/proc/self/smaps_rollup") as lines:
        return sum(int(line.split()[1]) for line in lines if line.startswith("Private"))

rclpy.init()
node = rclpy.create_node("listener")
kept = [node.create_subscription(EnergyRegisters, f"r{n}", print, 10, raw=True) for n in range(3)]
before = private()
kept += [node.create_subscription(EnergyRegisters, f"s{n}", print, 10, raw=True) for n in range(60)]
print((private() - before) / 60)
"""


def test_readers_make_room_as_messages_come(tmp_path):
    """Without the profile Fast DDS takes 120 kB for each reader, with it 30."""
    found = [
        float(
            subprocess.run(
                [sys.executable, "-c", MEMORY, how],
                capture_output=True, text=True, check=True, cwd=tmp_path,
            ).stdout
        )
        for how in ("by default", "as needed")
    ]  # fmt: skip
    assert found[1] < 0.5 * found[0]


def test_the_profiles_of_a_user_stay(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(VARIABLE, "mine.xml")
    make_room_as_needed()
    assert os.environ[VARIABLE] == "mine.xml"
    monkeypatch.delenv(VARIABLE)
    (tmp_path / OF_THE_FOLDER).touch()
    make_room_as_needed()
    assert VARIABLE not in os.environ
