"""Each message type, read by its source."""

import pickle

import numpy as np
import pytest

import temperature_messages as says
from robot_energy.foundation.errors import ParameterError
from robot_energy.inputs.sources import TemperatureSource
from robot_energy.inputs.temperatures.kinds import (
    DIAGNOSTICS,
    DYNAMIC_JOINT_STATE,
    FLOAT_ARRAY,
    INTERFACE_NAMES,
    INTERFACE_VALUES,
    MOTOR_TEMPERATURES,
    TEMPERATURE,
    TEMPERATURE_KINDS,
)
from robot_energy.inputs.temperatures.temperatures import TemperatureIngest

S = 10**9
NAN = np.nan
TENTHS = "scale: 0.1 if these are tenths of a degree"
FAULT = "which looks like a fault code: not used; check the sensor"


def read(messages, named=(), **settings):
    """Block and ingest of one source whose messages came at 1, 2, ... s."""
    source = TemperatureSource(topic="/t", **settings)
    ingest = TemperatureIngest(("a", "b"), {"motors": source})
    log = [S * (n + 1) for n in range(len(messages))]
    batches = [says.batch("/t", source.type, messages, log)]
    if named:
        rows = [says.interface_names(at, names) for at, names in named]
        batches.insert(0, says.batch("/names", INTERFACE_NAMES, rows, [at for at, _ in named]))
    block = ingest.step(batches)
    assert ingest.rejections.balanced
    assert ingest.rejections.received == len(messages)
    assert ingest.readers[0].keys_account.received == len(named)
    assert ingest.readers[0].keys_account.balanced
    return block, ingest


def same(values, expected):
    np.testing.assert_array_equal(values, expected)


def test_fahrenheit_is_converted_where_it_is_said():
    block, ingest = read([says.motor_temperatures(S, [77.0, 140.0], ("a", "b"))], unit="fahrenheit")
    np.testing.assert_allclose(block.motor_temperature_degc, [[25.0, 60.0]])
    assert ingest.doubts == []


def test_kelvin_is_taken_off_where_it_is_said():
    block, ingest = read([says.motor_temperatures(S, [300.0, 318.15], ("a", "b"))], unit="kelvin")
    np.testing.assert_allclose(block.motor_temperature_degc, [[26.85, 45.0]])
    assert ingest.doubts == []


@pytest.mark.parametrize(
    ("unit", "value", "sentence"),
    [
        ("degc", 318.15, "/t reads 318.15 for b: set unit: kelvin"),
        ("degc", 318.0, f"/t reads 318 for b: set unit: kelvin, or {TENTHS}"),
        ("degc", 349.4, f"/t reads 349.4 for b: set unit: kelvin, or {TENTHS}"),
        ("degc", 234.0, f"/t reads 234 for b: set {TENTHS}"),
        ("degc", 45.0, None),
        ("degc", 199.0, None),
        ("degc", 999.0, f"/t reads 999 for b, {FAULT}"),  # an error code in any unit
        ("degc", -273.15, f"/t reads -273.15 for b, {FAULT}"),
        ("degc", 6553.5, f"/t reads 6553.5 for b, {FAULT}"),
        ("kelvin", 45.0, "/t reads 45 for b: set unit: degc"),
        ("kelvin", 300.0, None),
    ],
)
def test_a_value_of_another_unit_is_named_and_never_converted(unit, value, sentence):
    good = 20.0 if unit == "degc" else 293.15
    block, ingest = read([says.motor_temperatures(S, [good, value], ("a", "b"))], unit=unit)
    assert ingest.doubts == ([] if sentence is None else [sentence])
    assert block.motor_temperature_degc[0, 1] == (value if unit == "degc" else value - 273.15)


@pytest.mark.parametrize(("unit", "good"), [("degc", 20.0), ("kelvin", 293.15), ("fahrenheit", 68)])
@pytest.mark.parametrize("code", [0.0, -1.0, -40.0, 127.0, 255.0])
def test_a_fault_code_is_not_used_and_its_joints_are_named(code, unit, good):
    rows = [[code, good], [code, code]]
    messages = [says.motor_temperatures(S * n, row, ("a", "b")) for n, row in enumerate(rows, 1)]
    block, ingest = read(messages, unit=unit)
    np.testing.assert_allclose(block.motor_temperature_degc, [[NAN, 20.0]])
    assert ingest.doubts == [f"/t reads {code:g} for a, {code:g} for b, {FAULT}"]
    assert ingest.rejections.rejected == {"not_finite": 1}


def test_a_temperature_that_comes_to_zero_by_steps_is_used_at_any_cutting():
    values = [0.0, 0.0, 1.0, 0.0, 0.0, -1.0, 30.0, 0.0, 28.5, -40.0]
    used = [1.0, 0.0, 0.0, -1.0, 30.0, 28.5]
    messages = [says.motor_temperatures(S * n, [v], ("a",)) for n, v in enumerate(values, 1)]
    block, ingest = read(messages)
    same(block.motor_temperature_degc[:, 0], used)
    assert ingest.doubts == [f"/t reads -40 for a, {FAULT}"]
    ingest = TemperatureIngest(("a",), {"motors": TemperatureSource(topic="/t")})
    parts = [
        ingest.step([says.batch("/t", MOTOR_TEMPERATURES, [message], [S * n])])
        for n, message in enumerate(messages, 1)
    ]
    same([each.motor_temperature_degc[0, 0] for each in parts if each is not None], used)


def test_tenths_of_a_degree_are_scaled_where_it_is_said():
    block, ingest = read([says.motor_temperatures(S, [300.0, 318.0], ("a", "b"))], scale=0.1)
    np.testing.assert_allclose(block.motor_temperature_degc, [[30.0, 31.8]])
    assert ingest.doubts == []


def test_doubt_about_the_unit_ends_with_good_values():
    source = TemperatureSource(topic="/t")
    ingest = TemperatureIngest(("a",), {"motors": source})
    for at, value in ((1, 318.0), (2, 45.0)):
        message = says.motor_temperatures(at * S, [value], ("a",))
        ingest.step([says.batch("/t", MOTOR_TEMPERATURES, [message], [at * S])])
        assert bool(ingest.doubts) == (value == 318.0)


def test_one_topic_of_temperature_for_one_joint():
    block, _ = read([says.temperature(S, 40.0, "flange")], type=TEMPERATURE, joints=("b",))
    same(block.motor_temperature_degc, [[NAN, 40.0]])
    block, ingest = read([says.temperature(S, 40.0, "flange")], type=TEMPERATURE)
    assert block is None
    assert ingest.rejections.rejected == {"unknown_joint": 1}


def test_frames_that_are_no_joint_names_are_mapped():
    block, ingest = read(
        [
            says.temperature(S, 40.0, "motor_1"),
            says.temperature(2 * S, 50.0, "motor_2"),
            says.temperature(3 * S, 60.0, "a"),
        ],
        type=TEMPERATURE,
        joints=("b", "a"),
        names=("motor_2", "motor_1"),
    )
    same(block.motor_temperature_degc, [[40.0, NAN], [NAN, 50.0]])
    assert ingest.rejections.rejected == {"unknown_joint": 1}
    assert ingest.ignored_joints == {"a"}


def test_an_array_is_read_in_the_order_of_the_joints_at_the_time_of_receipt():
    rows = [[21, 99, 22], [21, 22], [23, 99, NAN], [NAN, 9, NAN]]
    block, ingest = read(
        [says.float_array(row) for row in rows], type=FLOAT_ARRAY, joints=("b", "-", "a")
    )
    same(block.stamp_ns, [S, 3 * S])
    same(block.motor_temperature_degc, [[22, 21], [NAN, 23]])
    assert ingest.rejections.rejected == {"wrong_length": 1, "not_finite": 1}
    assert ingest.ignored_joints == set()
    assert ingest.readers[0].missing_readings == 3


def test_the_interface_of_a_dynamic_joint_state_that_is_a_temperature():
    messages = [
        says.dynamic_joint_state(
            S,
            ["b", "x", "a"],
            [{"position": 1.0, "temperature": 40.0}, {"temperature": 9.0}, {"temperature": 30.0}],
        ),
        says.dynamic_joint_state(2 * S, ["a", "b"], [{"position": 1.0}, {"temperature": 41.0}]),
        says.dynamic_joint_state(3 * S, ["a"], [{"position": 1.0}]),
        says.dynamic_joint_state(4 * S, ["a", "b"], [{"temperature": 1.0}]),
        says.dynamic_joint_state(5 * S, ["x"], [{"temperature": 1.0}]),
        says.dynamic_joint_state(0, ["a"], [{"temperature": 1.0}]),
    ]
    block, ingest = read(messages, type=DYNAMIC_JOINT_STATE)
    same(block.motor_temperature_degc, [[30.0, 40.0], [NAN, 41.0]])
    same(block.stamp_ns, [S, 2 * S])
    assert ingest.rejections.rejected == {
        "no_temperature": 1, "wrong_length": 1, "unknown_joint": 1, "zero_stamp": 1,
    }  # fmt: skip
    assert ingest.ignored_joints == {"x"}


def test_another_interface_may_be_meant():
    message = says.dynamic_joint_state(S, ["a"], [{"temperature": 1.0, "winding": 50.0}])
    block, _ = read([message], type=DYNAMIC_JOINT_STATE, interface="winding")
    same(block.motor_temperature_degc, [[50.0, NAN]])


KEYS = ("a/position", "a/temperature", "gpio/b/temperature", "b/temperature")


def test_values_are_read_by_the_keys_in_force_when_they_came():
    messages = [says.interface_values(n * S, [0.0, 30.0 + n, 9.0, 40.0 + n]) for n in range(1, 5)]
    messages.append(says.interface_values(5 * S, [1.0]))
    block, ingest = read(
        messages,
        type=INTERFACE_VALUES,
        named=[(int(1.5 * S), KEYS), (int(3.5 * S), (*KEYS[:3], "a/effort"))],
    )
    same(block.motor_temperature_degc, [[32, 42], [33, 43], [34, NAN]])
    assert ingest.rejections.rejected == {"before_names": 1, "wrong_length": 1}
    assert ingest.ignored_joints == {"gpio/b"}


def test_keys_stay_from_step_to_step():
    source = TemperatureSource(topic="/t", type=INTERFACE_VALUES)
    ingest = TemperatureIngest(("a", "b"), {"motors": source})
    assert ingest.topics == {"/names": INTERFACE_NAMES, "/t": INTERFACE_VALUES}
    keys = says.batch("/names", INTERFACE_NAMES, [says.interface_names(S, KEYS)], [S])
    assert ingest.step([keys]) is None
    for at in (2 * S, 3 * S):
        values = says.interface_values(at, [0.0, 30.0, 0.0, 40.0])
        block = ingest.step([says.batch("/t", INTERFACE_VALUES, [values], [at])])
        same(block.motor_temperature_degc, [[30.0, 40.0]])
    assert ingest.rejections.accepted == 2
    assert ingest.readers[0].keys_account.accepted == 1
    assert ingest.rejections.balanced


@pytest.mark.parametrize(
    ("text", "unit", "expected"),
    [
        ("45.2", "degc", 45.2),
        (" 45.2 C", "degc", 45.2),
        ("45.2 °C", "degc", 45.2),
        ("+4.52e1 degC ", "degc", 45.2),
        ("318.35", "kelvin", 45.2),
        ("318.35 K", "degc", 45.2),
        ("45.2 C", "kelvin", 45.2),
        ("-5", "degc", -5.0),
        ("n/a", "degc", None),
        ("", "degc", None),
        ("nan", "degc", None),
        ("45,2", "degc", None),
        ("113.36 °F", "degc", 45.2),
        ("113.36 F", "kelvin", 45.2),
        ("45.2 C", "fahrenheit", 45.2),
        ("113 R", "degc", None),
        ("0x2d", "degc", None),
    ],
)
def test_texts_of_diagnostics(text, unit, expected):
    message = says.diagnostics(S, {"drive 1": {"temperature": text}})
    block, ingest = diagnostic([message], unit=unit, names=("drive 1", "drive 2"))
    if expected is None:
        assert block is None
        assert ingest.rejections.rejected == {"not_a_number": 1}
    else:
        np.testing.assert_allclose(block.motor_temperature_degc, [[expected, NAN]])


def diagnostic(messages, **settings):
    return read(messages, type=DIAGNOSTICS, joints=("a", "b"), **settings)


def test_statuses_and_keys_of_diagnostics():
    both = {"arm: drive": {"speed": "1", "temp_a": "30", "temp_b": "40"}, "other": {"temp_a": "9"}}
    messages = [
        says.diagnostics(S, both),
        says.diagnostics(2 * S, {"other": {"temp_a": "9"}}),
        says.diagnostics(3 * S, {"arm: drive": {"temp_a": "off", "temp_b": "41"}}),
    ]
    block, ingest = diagnostic(messages, names=("arm*",), keys=("temp_a", "temp_b"))
    same(block.motor_temperature_degc, [[30.0, 40.0], [NAN, 41.0]])
    assert ingest.rejections.rejected == {"no_temperature": 1}
    assert ingest.readers[0].missing_readings == 1


def test_several_sources_keep_their_own_accounts():
    sources = {
        "arm": TemperatureSource(topic="/arm", joints=("a",)),
        "wrist": TemperatureSource(topic="/wrist", type=TEMPERATURE, joints=("b",), unit="kelvin"),
    }
    ingest = TemperatureIngest(("a", "b"), sources)
    block = ingest.step(
        [
            says.batch(
                "/arm",
                MOTOR_TEMPERATURES,
                [says.motor_temperatures(n * S, [30.0, 99.0], ("a", "b")) for n in (1, 3)],
                [S, 3 * S],
            ),
            says.batch(
                "/wrist", TEMPERATURE, [says.temperature(0, 1.0, ""), b"\0"], [2 * S, 2 * S]
            ),
        ]
    )
    same(block.motor_temperature_degc, [[30.0, NAN], [30.0, NAN]])
    arm, wrist = (reader.rejections for reader in ingest.readers)
    assert (arm.received, arm.accepted) == (2, 2)
    assert wrist.rejected == {"zero_stamp": 1, "malformed": 1}
    assert ingest.rejections.received == 4
    assert ingest.rejections.balanced


def test_a_source_may_use_the_time_of_receipt():
    message = says.temperature(0, 40.0, "a")
    block, _ = read([message], type=TEMPERATURE, stamp_source="receive")
    same(block.stamp_ns, [S])


def test_a_quick_source_counts_ten_times_a_second():
    stamps = (np.arange(1000) + 1) * 2_000_000
    messages = [says.motor_temperatures(int(at), [20.0], ("a",)) for at in stamps]
    source = TemperatureSource(topic="/t")
    ingest = TemperatureIngest(("a",), {"motors": source})
    block = ingest.step([says.batch("/t", MOTOR_TEMPERATURES, messages, stamps.tolist())])
    assert len(block) == 21
    assert ingest.step([says.batch("/t", MOTOR_TEMPERATURES, messages[-1:], [3 * S])]) is None
    assert ingest.rejections.accepted == 1001


def test_a_joint_that_the_model_lacks_is_refused_at_the_start():
    source = TemperatureSource(topic="/t", joints=("a", "q"))
    with pytest.raises(
        ParameterError, match=r"'motors' names q; expected joints of the model, a, b"
    ):
        TemperatureIngest(("a", "b"), {"motors": source})


@pytest.mark.parametrize("kind", TEMPERATURE_KINDS)
def test_what_reads_each_kind_goes_to_another_process(kind):
    source = TemperatureSource(topic="/t", type=kind, joints=("a",)).resolved(str)
    ingest = TemperatureIngest(("a", "b"), {"motors": source})
    assert pickle.loads(pickle.dumps(ingest)).readers[0].source == source
