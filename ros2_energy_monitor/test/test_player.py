"""A bag played to the monitors: every message once, in order, at the pace asked for."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from sensor_msgs.msg import JointState

from robot_energy.bag import BagReader, BagWriter
from robot_energy.errors import MissingTopicError, ReportError
from robot_energy.model_file import load, save
from robot_energy.replay import replay
from ros2_energy_monitor import live_study
from ros2_energy_monitor.player import Player, message_type

RATE = 8.0


def play(bench, bag: Path, topics=None) -> tuple[Player, float]:
    player = Player(bench.tester, BagReader(bag), RATE, topics)
    bench.spin_until(player.heard, "a subscriber")

    def pause(seconds: float) -> bool:
        bench.executor.spin_once(timeout_sec=seconds)
        return True

    begin = time.monotonic()
    player.play(pause)
    return player, time.monotonic() - begin


def test_every_message_once_byte_for_byte_and_in_order(bench, recording, messages):
    inbox = bench.inbox(JointState, "/joint_states")
    player, lasted = play(bench, recording)
    taken: list[bytes] = []

    def all_taken() -> bool:
        batch = inbox.drain()
        taken.extend(batch.row(index) for index in range(0 if batch is None else len(batch)))
        return len(taken) >= len(messages["/joint_states"])

    bench.spin_until(all_taken, "all joint states")
    assert taken == messages["/joint_states"]
    assert player.played == {topic: len(rows) for topic, rows in messages.items()}
    assert lasted > 0.9 * 8.0 / RATE  # never faster than asked for


def test_what_cannot_be_played_is_left_out_or_refused(bench, tmp_path):
    with BagWriter(tmp_path / "odd") as bag:
        bag.add_topic("/joint_states", "sensor_msgs/msg/JointState")
        bag.write("/joint_states", np.array([10**18]), [bytes(64)])
    reader = BagReader(tmp_path / "odd")
    with pytest.raises(MissingTopicError, match="no /torque"):
        Player(bench.tester, reader, 1.0, ["/torque"])
    assert message_type("sensor_msgs/msg/JointState") is JointState
    assert message_type("nobody_msgs/msg/Thing") is None
    assert message_type("sensor_msgs/msg/Thing") is None


def run(environment, module: str, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", f"ros2_energy_monitor.{module}", *words],
        env=environment, capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip


def test_commands_refuse_in_one_sentence(child_environment, tmp_path):
    done = run(child_environment, "player", str(tmp_path / "none"))
    assert (done.returncode, len(done.stdout.splitlines())) == (2, 1), done
    done = run(child_environment, "live_study", str(tmp_path))
    assert done.returncode == 2
    assert "robot-energy reproduce paper-a" in done.stdout
    assert run(child_environment, "player", "bag", "--rate", "0").returncode == 2


def test_a_study_that_is_none_is_refused(tmp_path):
    (tmp_path / "figures.json").write_text('{"sets": [{"bag": "a"}]}')
    with pytest.raises(ReportError, match="holds no study"):
        live_study.read_study(tmp_path)


def test_three_processes_give_the_energies_of_the_replay(
    child_environment, recording, tmp_path, capsys
):
    """A recording with a gap and a repeated sample, eight times as fast as nature."""
    books = replay(recording, load("kr16")).ledger.comparison
    entry = {
        "bag": "rig",
        "robot_degc": 20.0,
        "measured_energy": books.measured_energy,
        "predicted_energy": {"follows": books.predicted_energy},
    }
    (tmp_path / "bags").mkdir()
    (tmp_path / "bags" / "rig").symlink_to(recording)
    (tmp_path / "figures.json").write_text(json.dumps({"sets": [entry]}))
    save(load("kr16"), tmp_path / "identified.yaml")
    done = run(child_environment, "live_study", str(tmp_path), "--rate", str(RATE))
    assert done.returncode == 0, done.stdout + done.stderr
    assert "nodes and replay agree" in done.stdout
    (expected,) = live_study.read_study(tmp_path)

    class Registers:
        predicted_energy_at_meter = books.predicted_energy * 1.001
        measured_energy = books.measured_energy

    assert not live_study._tell(expected, Registers)
    assert "differs" in capsys.readouterr().out
    assert not live_study._tell(expected, None)
