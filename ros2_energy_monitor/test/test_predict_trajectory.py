# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The service that predicts a trajectory equals the command, and keeps no tick waiting."""

from __future__ import annotations

import json
import math
import subprocess
import threading
from types import SimpleNamespace

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from rclpy.serialization import serialize_message
from ros2_energy_msgs.msg import PowerState
from ros2_energy_msgs.srv import CompareTrajectories, PredictTrajectory, SetPayload
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from robot_energy.bag import BagWriter
from robot_energy.bag.cdr.types import typestore
from robot_energy.certainty.deviation import CABINET_DEVIATIONS, JOINT_DEVIATIONS
from robot_energy.model import load
from robot_energy.model.figure import Figure, PositiveFigure
from robot_energy.model.schema import CabinetFan
from robot_energy.pipeline import EnergyPipeline
from robot_energy_cli.main import main
from robot_energy_plan.motion.joint_trajectory import KINDS, MESSAGE, PointColumns
from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor
from ros2_energy_monitor.services import trajectory_services
from ros2_energy_monitor.services.prediction_process import PredictionProcess
from ros2_energy_monitor.services.raw_service import CMessage
from ros2_energy_monitor.services.trajectory_answers import compared, predicted

MODEL = load("kr16")
JOINTS = MODEL.joint_names
ENERGIES = (
    "shaft_energy_positive",
    "shaft_energy_negative",
    "rigid_energy",
    "friction_energy",
    "drive_loss_energy",
)


def swing(joint_names=JOINTS, seconds=2) -> JointTrajectory:
    """There and back of all joints, from rest to rest."""
    shape = np.array([0.0, 0.4, 0.9, 0.5, 0.0])
    points = [
        JointTrajectoryPoint(
            positions=(share * np.linspace(0.3, -0.5, len(joint_names))).tolist(),
            time_from_start=Duration(sec=index * seconds),
        )
        for index, share in enumerate(shape.tolist())
    ]
    return JointTrajectory(joint_names=list(joint_names), points=points)


class Client:
    """Asks the service of a bench."""

    def __init__(self, bench) -> None:
        self._bench = bench
        self._client = bench.tester.create_client(
            PredictTrajectory, "energy_monitor/predict_trajectory"
        )
        bench.spin_until(self._client.service_is_ready, "the service")

    def close(self) -> None:
        self._bench.tester.destroy_client(self._client)

    def send(self, **request):
        return self._client.call_async(PredictTrajectory.Request(**request))

    def ask(self, **request) -> PredictTrajectory.Response:
        future = self.send(**request)
        self._bench.spin_until(future.done, "the prediction")
        return future.result()


@pytest.fixture
def node(bench):
    return bench.add(EnergyMonitor, model="kr16", state_folder="")


@pytest.fixture
def client(bench, node):
    return Client(bench)


def as_sent(trajectory) -> bytes:
    """The message as bags hold it: rclpy leaves unused bytes at the end."""
    data, store = serialize_message(trajectory), typestore()
    definition = store.get_msgdef(MESSAGE)
    _, size = definition.deserialize_cdr_le(memoryview(data)[4:], 0, definition.cls, store)
    return data[: 4 + size]


def by_command(tmp_path, trajectory, *options) -> dict:
    """What `robot-energy predict` says about the same message."""
    bag = tmp_path / f"{len(list(tmp_path.iterdir()))}.mcap"
    with BagWriter(bag) as writer:
        writer.add_topic("/plan", MESSAGE)
        row = np.frombuffer(as_sent(trajectory), dtype=np.uint8)
        writer.write("/plan", np.array([10**9]), row[None, :])
    out = tmp_path / "out.json"
    assert main(["predict", str(bag), "--model", "kr16", "--json", str(out), *options]) == 0
    return json.loads(out.read_text())["runs"][0]


def compare(answer, run) -> None:
    assert answer.success, answer.message
    assert answer.duration == run["time"]["duration"]
    assert answer.predicted_import_energy == run["energy"]["grid_import"] > 0
    sure = run["uncertainty"]
    assert answer.predicted_energy_std == sure["std"] > 0
    assert 2.0 * answer.predicted_energy_band == pytest.approx(sure["upper"] - sure["lower"])
    assert answer.band == PowerState.BAND_PARAMETRIC
    assert answer.predicted_return_energy == run["energy"]["grid_return"]
    assert answer.brake_energy == run["energy"]["brake"]
    assert answer.predicted_peak_power == run["power"]["predicted_peak_grid_power"]
    assert answer.predicted_mean_power == run["power"]["predicted_mean_grid_power"]
    assert [joint.name for joint in answer.joints] == [joint["name"] for joint in run["joints"]]
    for joint, expected in zip(answer.joints, run["joints"], strict=True):
        values = [math.nan if expected[key] is None else expected[key] for key in ENERGIES]
        assert [getattr(joint, key) for key in ENERGIES] == pytest.approx(values, 0, 0, nan_ok=True)
        assert math.isnan(joint.shaft_energy_positive_measured)
    assert list(answer.motor_temperature_degc) == list(run["motor_temperature_degc"].values())
    assert answer.extrapolated == bool(run["friction"]["extrapolated_joints"])


@pytest.mark.usefixtures("kept_process")
def test_the_service_equals_the_command(client, tmp_path):
    """Temperatures follow the names, and the fallback fills those that are missing."""
    trajectory = swing()
    run = by_command(tmp_path, trajectory, "--temperature", "40", "--repeat", "3")
    answer = client.ask(trajectory=trajectory, repeat=3, motor_temperature_degc=[40.0] * 6)
    compare(answer, run)
    trajectory = swing(JOINTS[::-1])
    given = [30.0, 31.0, math.nan, 33.0, 34.0, 35.0]
    fallback = MODEL.temperature.fallback_degc
    used = [fallback if math.isnan(value) else value for value in given[::-1]]
    run = by_command(tmp_path, trajectory, "--temperature", ",".join(map(str, used)))
    compare(client.ask(trajectory=trajectory, motor_temperature_degc=given), run)


@pytest.mark.usefixtures("kept_process")
@pytest.mark.parametrize(
    ("asked_degc", "on_above_degc", "runs"),
    [(math.nan, 41.0, False), (math.nan, 39.0, True), (45.0, 44.0, True), (38.0, 39.0, True)],
)
def test_a_fan_runs_by_readings_as_in_the_monitor_and_by_temperatures_as_asked(
    asked_degc, on_above_degc, runs
):
    """The first motor reads 45 degC with 40, the second has 39.5; errors of those asked are none.

    The warmest has 40, 40, 45 and 39.5 degC.
    """
    power, width = (PositiveFigure(value=value, tag="assumed") for value in (50.0, 10.0))
    on = Figure(value=on_above_degc, tag="assumed")
    fan = CabinetFan(
        power=power, on_above_degc=on, hysteresis=width, begins_off_to_degc=on,
        thermometers=(5.0, -1.5, 0.0, 0.0, 0.0, 0.0),
    )  # fmt: skip
    model = MODEL.changed(cabinet=MODEL.cabinet.model_copy(update={"fan": fan}))
    readings, asked = np.array([45.0, 38.0, 30.0, 30.0, 30.0, math.nan]), np.full(6, math.nan)
    asked[0], asked[5] = asked_degc, 20.0
    still = PointColumns.of(swing())
    request = SimpleNamespace(
        trajectory=still, repeat=1, motor_temperature_degc=asked,
        trajectories=[still], joint_names=JOINTS, cycle_time=0.0, peak_limit=0.0,
    )  # fmt: skip
    never = EnergyPipeline(MODEL).account.calibration.state()
    answers = [
        (predicted(one, request, (), readings, never),
         compared(one, request, (), readings, never)["candidates"][0])
        for one in (MODEL, model)
    ]  # fmt: skip
    (bare, bare_compared), (found, found_compared) = answers
    assert found["motor_temperature_degc"] == bare["motor_temperature_degc"]
    fan_energy = pytest.approx(50.0 * 8.0 * runs, abs=1e-6)
    assert found["predicted_import_energy"] - bare["predicted_import_energy"] == fan_energy
    assert found_compared["predicted_energy"] - bare_compared["predicted_energy"] == fan_energy


def test_what_the_meter_has_shown_sets_the_band(node, client):
    """Windows without error, in which every figure moved 10 kJ: all figures are known then."""
    bare = client.ask(trajectory=swing())
    figures = len(CABINET_DEVIATIONS) - 4 + len(JOINT_DEVIATIONS) * len(JOINTS)
    seen = node.account.calibration.state().model_copy(
        update={
            "location": "GRID",
            "energy_windows": ((0.0, 0.0, 10.0),) * 24,
            "energy_figures": tuple(map(tuple, 1e8 * np.eye(figures))),
        }
    )
    node.account.calibration.restore(seen)
    answer = client.ask(trajectory=swing())
    assert answer.band == PowerState.BAND_CALIBRATED
    assert answer.predicted_energy_std == bare.predicted_energy_std
    assert 0.0 < answer.predicted_energy_band < 0.5 * bare.predicted_energy_band


@pytest.mark.usefixtures("kept_process")
def test_the_payload_that_is_carried_counts(bench, client, tmp_path):
    request = bench.payload("tool0", 8.0)
    setter = bench.tester.create_client(SetPayload, "energy_monitor/set_payload")
    bench.spin_until(setter.service_is_ready, "the service")
    future = setter.call_async(request)
    bench.spin_until(future.done, "the payload")
    assert future.result().success
    said = "15 kg on 'flange' and 8 kg on 'tool0', 23 kg in all"  # next to that of the model
    assert said in future.result().message
    trajectory = swing()
    run = by_command(tmp_path, trajectory, "--temperature", "40", "--payload", "8")
    answer = client.ask(trajectory=trajectory, motor_temperature_degc=[40.0] * 6)
    compare(answer, run)
    assert said in answer.message
    bare = by_command(tmp_path, trajectory, "--temperature", "40")
    assert bare["energy"]["grid_import"] != run["energy"]["grid_import"]


REFUSED = [
    {"trajectory": JointTrajectory()},
    {"trajectory": swing(JOINTS[:-1])},
    {"trajectory": swing((*JOINTS[:-1], "stranger"))},
    {"trajectory": swing(seconds=1_000_000)},
    {"trajectory": swing(), "repeat": 2**32 - 1},
    {"trajectory": swing(), "motor_temperature_degc": [20.0]},
    {"trajectory": swing(), "motor_temperature_degc": [math.inf] * 6},
    {"trajectory": swing(), "motor_temperature_degc": [900.0] * 6},
]


@pytest.mark.usefixtures("kept_process")
def test_what_cannot_be_predicted_is_refused(client):
    for request in REFUSED:
        answer = client.ask(**request)
        assert not answer.success
        assert math.isnan(answer.predicted_import_energy + answer.duration)
        assert "expected" in answer.message
        assert client.ask(trajectory=swing()).success


class Held:
    """The process of predictions: started, asked, and its answers kept back until `go`."""

    def __init__(self, monkeypatch) -> None:
        self.go, self.asked = threading.Event(), threading.Event()
        self.processes: list[subprocess.Popen[bytes]] = []
        ask, answer = PredictionProcess.ask, PredictionProcess.answer

        def note(process, asked, request):
            self.processes.append(process.start())
            ask(process, asked, request)
            self.asked.set()

        def wait(process, timeout):
            return answer(process, timeout) if self.go.wait(timeout) else None

        monkeypatch.setattr(PredictionProcess, "ask", note)
        monkeypatch.setattr(PredictionProcess, "answer", wait)


@pytest.fixture
def held(monkeypatch) -> Held:
    return Held(monkeypatch)


@pytest.mark.usefixtures("kept_process")
def test_ticks_go_on_and_a_second_request_is_refused(bench, node, client, held, monkeypatch):
    first = client.send(trajectory=swing())
    bench.spin_until(held.asked.is_set, "the prediction to begin")
    ticks = []
    tick = node.tick
    monkeypatch.setattr(node, "tick", lambda: (ticks.append(1), tick()))
    bench.spin_until(lambda: len(ticks) > 5, "ticks next to the prediction")
    second = client.ask(trajectory=swing())
    assert not second.success
    assert "a prediction is under way" in second.message
    assert not first.done()
    held.go.set()
    bench.spin_until(first.done, "the first answer")
    assert first.result().success


def test_cleanup_gives_up_a_prediction_and_answers(bench, node, client, held):
    future = client.send(trajectory=swing())
    bench.spin_until(held.asked.is_set, "the prediction to begin")
    threads = [one for one in threading.enumerate() if "predict_trajectory" in one.name]
    node.trigger_deactivate()
    node.trigger_cleanup()
    bench.spin_until(future.done, "the answer")
    assert not future.result().success
    assert "stopped" in future.result().message
    assert len(threads) == 1
    assert not threads[0].is_alive()
    assert held.processes[0].returncode is not None


def test_a_process_that_ends_is_an_error_and_the_next_request_has_another(
    bench, node, client, held, monkeypatch
):
    future = client.send(trajectory=swing())
    bench.spin_until(held.asked.is_set, "the prediction to begin")
    noted = []
    monkeypatch.setattr(node.guard, "note", lambda path, error: noted.append(str(error)))
    held.processes[0].kill()
    held.go.set()
    bench.spin_until(future.done, "the answer")
    assert not future.result().success
    assert "has ended with -9" in noted[0]
    assert client.ask(trajectory=swing()).success


@pytest.mark.usefixtures("kept_process")
def test_what_is_too_long_is_refused_before_anything_is_converted(client, held, monkeypatch):
    """Some 1,600 samples of 8 s, and 5 points."""
    monkeypatch.setattr(trajectory_services, "MAX_SAMPLES", 4817)
    held.go.set()
    assert client.ask(trajectory=swing(), repeat=2).success
    asked = len(held.processes)
    monkeypatch.setattr(CMessage, "serialised", lambda message: pytest.fail("it was converted"))
    answer = client.ask(trajectory=swing(), repeat=3)
    assert not answer.success
    assert "4818 samples over 24 s were asked for; expected at most 4817 samples" in answer.message
    assert len(held.processes) == asked


@pytest.mark.long
def test_memory_of_a_long_trajectory_is_given_back(bench, client, held, monkeypatch):
    held.go.set()
    assert client.ask(trajectory=swing()).success
    monkeypatch.setattr(trajectory_services, "LARGE", 1000)
    assert client.ask(trajectory=swing()).success
    first = held.processes[0]
    assert held.processes[1] is first
    assert first.returncode is not None
    assert client.ask(trajectory=swing()).success
    assert held.processes[2] is not first


@pytest.mark.usefixtures("kept_process")
def test_a_service_is_renewed_after_a_long_request_when_no_client_is_left(
    bench, node, client, monkeypatch
):
    monkeypatch.setattr(trajectory_services, "LARGE", 3)
    first = served(node)
    assert client.ask(trajectory=swing()).success
    assert client.ask(trajectory=swing()).success
    assert served(node) is first
    client.close()
    bench.spin_until(lambda: served(node) not in (None, first), "another service")
    other = Client(bench)
    assert other.ask(trajectory=swing()).success
    other.close()


def served(node):
    """The service of rclpy; None while there is none."""
    names = (each for each in node.services if each.service_name.endswith("/predict_trajectory"))
    return next(names, None)


def test_the_process_is_there_as_long_as_there_is_a_client(bench, client, held, monkeypatch):
    held.go.set()
    assert client.ask(trajectory=swing()).success
    (process,) = held.processes
    assert process.poll() is None
    monkeypatch.setattr(trajectory_services, "KEPT", 0.0)
    client.close()
    bench.spin_until(lambda: process.returncode is not None, "the end of the process")


def test_memory_of_a_request_is_read_as_rclpy_converts_it():
    """Points that lack figures or have too many of them, names, scalars."""
    trajectory = swing()
    trajectory.points[1].velocities = [1.0] * 6
    trajectory.points[2].accelerations = [1.0] * 5
    trajectory.points[3].time_from_start = Duration(sec=-1, nanosec=7)
    request = PredictTrajectory.Request(
        trajectory=trajectory, repeat=7, motor_temperature_degc=[1.5, math.nan]
    )
    sent = CMessage(PredictTrajectory.Request).fill(request)
    memory = CMessage(PredictTrajectory.Request)
    with sent.serialised() as data:
        sent.free()
        memory.deserialise(bytes(data))
    found = memory.read()
    memory.free()
    expected = PointColumns.of(trajectory)
    assert found.repeat == 7
    np.testing.assert_array_equal(found.motor_temperature_degc, [1.5, math.nan])
    assert found.trajectory.joint_names == expected.joint_names == JOINTS
    np.testing.assert_array_equal(found.trajectory.time, expected.time)
    for kind in KINDS:
        lengths, values = getattr(found.trajectory, kind)
        np.testing.assert_array_equal(lengths, getattr(expected, kind)[0])
        if kind != "accelerations":  # of a wrong length: refused without its figures
            np.testing.assert_array_equal(values, getattr(expected, kind)[1])
    several = CompareTrajectories.Request(
        trajectories=[swing(), JointTrajectory()], joint_names=["a", "b"], cycle_time=2.5
    )
    memory = CMessage(CompareTrajectories.Request).fill(several)
    found = memory.read()
    memory.free()
    assert [len(one.time) for one in found.trajectories] == [5, 0]
    assert (found.joint_names, found.cycle_time) == (["a", "b"], 2.5)
