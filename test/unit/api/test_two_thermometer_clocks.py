"""Two thermometers whose clocks are an hour apart: the friction of some joints is not known."""

import numpy as np
import pytest

import robots
from robot_energy.bag import BagWriter
from robot_energy.bag.cdr import Encoder, stamp_columns
from robot_energy.replay.api import replay

MODEL = robots.two_link()
JOINT_STATE = "sensor_msgs/msg/JointState"
TEMPERATURES = "ros2_energy_msgs/msg/MotorTemperatures"
SECOND = 10**9


@pytest.mark.parametrize("offset", [-3600, 3600])
def test_two_clocks_are_a_problem_and_one_is_none(tmp_path, offset):
    """So the command ends with 3, and says which topic has the other clock."""
    found = []
    for by in (0, offset):
        folder = tmp_path / f"bag{by}"
        stamp = 10_000 * SECOND + np.arange(2000) * SECOND // 20
        angle = 0.3 * np.sin(stamp[:, None] / SECOND)
        encoder = Encoder(
            JOINT_STATE, {"name": MODEL.joint_names}, {"position": 2, "velocity": 0, "effort": 0}
        )
        none = np.zeros((len(stamp), 0))
        columns = stamp_columns(stamp) | {
            "position": angle + np.array([0.0, 0.1]),
            "velocity": none,
        }
        with BagWriter(folder) as bag:
            bag.add_topic("/joint_states", JOINT_STATE)
            rows = encoder.encode(columns | {"effort": none}, len(stamp))
            seconds = stamp[::20]
            for number in range(2):
                bag.add_topic(f"/heat_{number}", TEMPERATURES)
            for second in range(len(seconds)):
                part = slice(20 * second, 20 * second + 20)
                bag.write("/joint_states", stamp[part], rows[part])
                for number, name in enumerate(MODEL.joint_names):
                    heat = Encoder(TEMPERATURES, {"joint_names": (name,)}, {"temperature_degc": 1})
                    at = seconds[second : second + 1] + number * by * SECOND
                    degc = {"temperature_degc": np.full((1, 1), 40.0)}
                    row = heat.encode(stamp_columns(at) | degc, 1)
                    bag.write(f"/heat_{number}", seconds[second : second + 1], row)
        found.append(replay(folder, MODEL))
    sound, torn = found
    assert not sound.problems
    assert any("two clocks?" in problem and "/heat_" in problem for problem in torn.problems)
