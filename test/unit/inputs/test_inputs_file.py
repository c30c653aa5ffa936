import pytest

from places import ROOT
from robot_energy.foundation.errors import ParameterError
from robot_energy.inputs.inputs_file import read_inputs
from robot_energy.inputs.sources import Inputs, TemperatureSource
from robot_energy.inputs.temperatures.kinds import FLOAT_ARRAY

CONFIG = ROOT / "ros2_energy_monitor" / "config"


def written(folder, text):
    path = folder / "inputs.yaml"
    path.write_text(text)
    return path


def test_the_configuration_of_the_node_gives_the_defaults():
    for name in ("energy_monitor", "friction_monitor"):
        assert read_inputs(CONFIG / f"{name}.yaml") == (Inputs(), [])


@pytest.mark.parametrize("node", ["/**", "energy_monitor", "/robot/energy_monitor"])
@pytest.mark.parametrize("nested", [True, False])
def test_groups_are_read_nested_or_by_full_name(tmp_path, node, nested):
    group = "    arm: {topic: t, type: std_msgs/msg/Float64MultiArray, joints: [a, b]}\n"
    if not nested:
        group = (
            "    arm.topic: t\n"
            "    arm.type: std_msgs/msg/Float64MultiArray\n"
            "    arm.joints: [a, b]\n"
        )
    text = f"{node}:\n  ros__parameters:\n    tick_rate: 5\n    temperature_sources: [arm]\n{group}"
    inputs, notes = read_inputs(written(tmp_path, text))
    source = TemperatureSource(topic="t", type=FLOAT_ARRAY, joints=("a", "b"))
    assert inputs.temperature_sources == {"arm": source}
    assert notes == []


def test_entries_of_several_nodes_are_joined(tmp_path):
    text = "/**:\n  ros__parameters: {temperature_sources: [arm]}\n"
    text += "friction_monitor:\n  ros__parameters: {arm: {topic: t}}\n"
    inputs, _ = read_inputs(written(tmp_path, text))
    assert inputs.temperature_sources == {"arm": TemperatureSource(topic="t")}


def test_probable_misspellings_are_named(tmp_path):
    text = "/**:\n  ros__parameters:\n    model: kr16\n    temperature_source: [arm]\n"
    text += "    motors: {topik: t, colour: red}\n"
    _, notes = read_inputs(written(tmp_path, text))
    assert len(notes) == 3
    assert "'temperature_source'; did you mean 'temperature_sources'?" in notes[0]
    assert "'motors.topik'; did you mean 'motors.topic'?" in notes[1]
    assert "'motors.colour'" in notes[2]


def test_the_remedy_of_a_file_without_node_is_right(tmp_path):
    """As the lines are that `check` prints: they say what stands below the node."""
    line = "joint_states: {effort_meaning: motor_torque}\n"
    with pytest.raises(ParameterError, match="'/\\*\\*:' and, indented, 'ros__parameters:' first"):
        read_inputs(written(tmp_path, line))
    inputs, _ = read_inputs(written(tmp_path, f"/**:\n  ros__parameters:\n    {line}"))
    assert inputs.joint_states.effort_meaning == "motor_torque"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("temperature_sources: [arm]\n", "holds no ROS parameters"),
        ("[]", "holds no ROS parameters"),
        ("a: [", "is not valid YAML"),
        ("/**: &a\n  ros__parameters: {b: *a}\n", "a YAML alias"),
        ("/**: {ros__parameters: {temperature_sources: arm}}\n", "is 'arm'; expected a list"),
        ("/**: {ros__parameters: {motors: {unit: celsius}}}\n", "one of degc, kelvin, fahrenheit"),
        ("/**: {ros__parameters: {motors: {names: [f]}}}\n", "'motors' of .*joints is empty"),
        (
            "a: {ros__parameters: {motors.unit: degc}}\n"
            "b: {ros__parameters: {motors.unit: kelvin}}",
            "motors.unit to 'degc', and for b to 'kelvin'",
        ),
    ],
)
def test_wrong_files_are_refused_in_one_sentence(tmp_path, text, words):
    with pytest.raises(ParameterError, match=words) as caught:
        read_inputs(written(tmp_path, text))
    assert "\n" not in str(caught.value)
    assert "inputs.yaml" in str(caught.value)


def test_a_file_that_cannot_be_read(tmp_path):
    with pytest.raises(ParameterError, match="cannot be read"):
        read_inputs(tmp_path / "none.yaml")
    with pytest.raises(ParameterError, match="larger than"):
        read_inputs(written(tmp_path, "#" * 2**21))
