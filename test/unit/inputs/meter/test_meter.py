"""Meters of every type: what a reading becomes, worked out by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_energy.accounting.comparison import Comparison
from robot_energy.bag.cdr.decode import RawBatch
from robot_energy.bag.cdr.types import extended, typestore
from robot_energy.foundation.errors import MessageTypeError, ParameterError
from robot_energy.inputs.meter.meter import MeterIngest
from robot_energy.inputs.meter.source import (
    BATTERY_STATE,
    FLOAT32,
    FLOAT64,
    POWER_READING,
    MeterSource,
)
from robot_energy.timeline.blocks import MeterBlock, MeterLocation, MeterMeaning

SECOND = 10**9
STORE = typestore()
GRID = {"location": "grid"}
POWER = {"type": FLOAT64, "unit": "W", "meaning": "instantaneous", **GRID}
COUNTER = {"type": FLOAT64, "unit": "Wh", **GRID}
PAIR = {
    "type": FLOAT64,
    "voltage_topic": "/voltage",
    "current_topic": "/current",
    "location": "dc_bus",
}


def header(stamp_s):
    time = STORE.types["builtin_interfaces/msg/Time"]
    stamp = round(stamp_s * 1e9)
    return STORE.types["std_msgs/msg/Header"](time(stamp // SECOND, stamp % SECOND), "")


def floats(topic, stamp_s, values, msgtype=FLOAT64):
    """Messages without a stamp, received at given times."""
    rows = [bytes(STORE.serialize_cdr(STORE.types[msgtype](value), msgtype)) for value in values]
    times = np.rint(np.asarray(stamp_s, dtype=float) * 1e9).astype(np.int64)
    return RawBatch.from_messages(topic, msgtype, times, rows)


def batteries(rows, received_s=99.0):
    """BatteryState messages from stamps, voltages and currents."""
    kind = STORE.types[BATTERY_STATE]
    nan, none = float("nan"), np.empty(0, dtype=np.float32)
    messages = [
        bytes(
            STORE.serialize_cdr(
                kind(
                    header(stamp), voltage, nan, current, nan, nan, nan, nan, 0, 0, 0, True,
                    none, none, "", "",
                ),
                BATTERY_STATE,
            )
        )
        for stamp, voltage, current in rows
    ]  # fmt: skip
    times = [round(received_s * 1e9)] * len(rows)
    return RawBatch.from_messages("/battery", BATTERY_STATE, times, messages)


def compared(block: MeterBlock | None, seconds: float):
    """Measured energy and compared time next to a prediction of 1 W from 0 s on."""
    comparison = Comparison()
    if block is not None:
        comparison.measure(block)
    stamp = np.arange(0, round(seconds * 1e9) + 1, SECOND // 10)
    comparison.predict(stamp, np.zeros(len(stamp), dtype=np.int64), np.ones(len(stamp)))
    return comparison.measured_energy, comparison.compared_ns / SECOND


def test_a_float_of_power_is_stamped_by_its_receipt():
    ingest = MeterIngest(MeterSource(**{**POWER, "unit": "kW"}))
    block = ingest.step([floats("/p", [1.0, 2.0, 3.0], [0.1, 0.2, 0.3])])
    assert block is not None
    assert block.stamp_ns.tolist() == [SECOND, 2 * SECOND, 3 * SECOND]
    assert block.meaning is MeterMeaning.INSTANTANEOUS
    assert block.location is MeterLocation.GRID
    assert compared(block, 5.0) == (pytest.approx(400.0), 2.0)  # trapezoids 150 + 250
    assert ingest.rejections.received == ingest.rejections.accepted == 3


def test_a_constant_power_for_an_hour_is_what_it_says():
    ingest = MeterIngest(MeterSource(**POWER))
    block = ingest.step([floats("/p", 1.0 + np.arange(3601.0), [33.5] * 3601)])
    energy, time = compared(block, 3602.0)
    assert energy / 3600 == pytest.approx(33.5)  # Wh
    assert time == 3600.0


def test_a_reading_without_a_location_is_not_one_without_a_meaning():
    kind = STORE.types[POWER_READING]
    nan = float("nan")
    rows = [
        bytes(STORE.serialize_cdr(kind(header(1.0), *said, 100.0, nan, nan), POWER_READING))
        for said in ((1, 0), (0, 1), (0, 0), (1, 1))
    ]
    ingest = MeterIngest()
    block = ingest.step([RawBatch.from_messages("/power_meter", POWER_READING, [SECOND] * 4, rows)])
    assert len(block) == 1
    assert ingest.rejections.rejected == {"unknown_location": 1, "unknown_meaning": 2}
    assert ingest.rejections.balanced
    assert ingest.refused == (
        "of 4 messages of the power meter 2 unknown_meaning, 1 unknown_location were refused"
    )


def test_float32_is_read_as_well():
    ingest = MeterIngest(MeterSource(**{**POWER, "type": FLOAT32}))
    block = ingest.step([floats("/p", [1.0, 2.0], [100.0, 300.0], FLOAT32)])
    assert compared(block, 3.0) == (pytest.approx(200.0), 1.0)


@pytest.mark.parametrize("source", [{**POWER, "unit": "kW"}, {**COUNTER, "unit": "kWh"}])
def test_a_reading_beyond_all_numbers_is_counted_and_compared_with_nothing(source):
    ingest = MeterIngest(MeterSource(**source))
    block = ingest.step([floats("/p", [1.0, 2.0, 3.0], [1e308, 1e308, 1e308])])
    assert ingest.rejections.received == 3
    assert ingest.rejections.balanced
    assert compared(block, 4.0)[0] == 0.0


@pytest.mark.parametrize(
    ("unit", "joule"), [("J", 1.0), ("kJ", 1e3), ("Wh", 3600.0), ("kWh", 3.6e6)]
)
def test_a_counter_in_any_unit_gives_joules_and_never_its_lifetime_value(unit, joule):
    ingest = MeterIngest(MeterSource(**{**COUNTER, "unit": unit}))
    count = 5e5 + np.array([0.0, 50.0, 100.0]) / joule
    block = ingest.step([floats("/e", [1.0, 2.0, 3.0], count)])
    assert block.meaning is MeterMeaning.CUMULATIVE
    assert compared(block, 4.0) == (pytest.approx(100.0, rel=1e-4), 2.0)


def test_a_meter_that_counts_the_other_way_round_and_behind_a_transformer():
    source = MeterSource(**{**COUNTER, "unit": "J", "sign": "load_negative", "scale": 10.0})
    block = MeterIngest(source).step([floats("/e", [1.0, 2.0], [-500.0, -507.0])])
    assert compared(block, 2.0) == (pytest.approx(70.0), 1.0)


@pytest.mark.parametrize(("at", "start"), [("end", 0.0), ("centre", 1.0), ("start", 2.0)])
def test_a_mean_covers_the_interval_that_its_stamp_marks(at, start):
    source = MeterSource(
        **{**POWER, "meaning": "mean_over_interval", "interval": 2.0, "stamp_at": at}
    )
    block = MeterIngest(source).step([floats("/p", [2.0], [50.0])])
    comparison = Comparison()
    comparison.measure(block)
    stamp = np.array([0, start * SECOND, (start + 2) * SECOND, 9 * SECOND], dtype=np.int64)
    comparison.predict(stamp, np.array([0, 0, 0, 0]), np.array([0.0, 0.0, 8.0, 8.0]))
    assert comparison.measured_energy == pytest.approx(100.0)
    assert comparison.predicted_energy == pytest.approx(8.0)  # the ramp from 0 to 8 W


def test_the_offset_of_a_clock_is_taken_off():
    source = MeterSource(**{**POWER, "stamp_offset": -183.5})
    block = MeterIngest(source).step([floats("/p", [183.5, 184.5], [10.0, 10.0])])
    assert block.stamp_ns.tolist() == [0, SECOND]


def test_a_battery_that_discharges_feeds_the_load():
    ingest = MeterIngest(MeterSource(type=BATTERY_STATE))
    nan = float("nan")
    rows = [(1.0, 48.0, -2.0), (2.0, 48.0, nan), (3.0, 50.0, -4.0), (0.0, 48.0, -2.0)]
    block = ingest.step([batteries(rows)])
    assert block.power.tolist() == [96.0, 200.0]
    assert block.stamp_ns.tolist() == [SECOND, 3 * SECOND]
    assert block.location is MeterLocation.DC_BUS
    assert ingest.rejections.rejected == {"not_finite": 1, "zero_stamp": 1}
    assert ingest.rejections.balanced
    charging = ingest.step([batteries([(4.0, 50.0, 1.0)])])
    assert charging.power.tolist() == [-50.0]


def test_a_battery_without_stamps_can_be_read_by_receipt():
    ingest = MeterIngest(MeterSource(type=BATTERY_STATE, stamp_source="receive", location="grid"))
    block = ingest.step([batteries([(0.0, 48.0, -2.0)], received_s=7.0)])
    assert block.stamp_ns.tolist() == [7 * SECOND]
    assert block.location is MeterLocation.GRID


def test_voltage_and_current_are_multiplied_where_both_are_fresh():
    ingest = MeterIngest(MeterSource(**PAIR))
    block = ingest.step(
        [
            floats("/voltage", [0.5, 1.5, 6.0], [48.0, 50.0, 52.0]),
            floats("/current", [0.4, 1.0, 1.5, 2.5, 2.6, 6.1], [9.0, 2.0, 2.0, 3.0, 3.0, 1.0]),
        ]
    )
    # 0.4 has no voltage yet, 2.6 only one of 1.1 s age, and 6.1 waits for a later message
    assert block.stamp_ns.tolist() == [SECOND, 3 * SECOND // 2, 5 * SECOND // 2]
    assert block.power.tolist() == [96.0, 100.0, 150.0]
    assert ingest.rejections.rejected == {"unpaired": 2}
    assert ingest.rejections.balanced
    late = ingest.step([floats("/voltage", [7.0], [50.0])])
    assert late.power.tolist() == [52.0]
    assert (ingest.rejections.received, ingest.rejections.accepted) == (10, 8)


def test_a_pair_refuses_what_is_no_number_and_forgets_when_the_clock_steps_back():
    ingest = MeterIngest(MeterSource(**PAIR))
    nan = float("nan")
    block = ingest.step(
        [
            floats("/voltage", [100.0, 100.1], [48.0, nan]),
            floats("/current", [100.2, 100.3, 100.4], [1.0, nan, 2.0]),
        ]
    )
    assert block.power.tolist() == [48.0]
    assert ingest.step([floats("/current", [50.0, 50.1], [1.0, 1.0])]) is None
    assert ingest.rejections.rejected == {"not_finite": 2, "unpaired": 2}
    assert ingest.rejections.balanced


OTHER = "acme_msgs/msg/PowerStamped"
DEFINITIONS = {
    OTHER: ("ros2msg", "std_msgs/Header header\nacme_msgs/Measurement measurement\n"),
    "acme_msgs/msg/Measurement": ("ros2msg", "float64 power\nfloat64[] raw\nstring note\n"),
    "acme_msgs/msg/Plain": ("ros2msg", "int32 watts\n"),
    "acme_msgs/msg/Phases": ("ros2msg", "acme_msgs/Measurement[] phases\nfloat64 standby\n"),
}
WIDER = extended(STORE, DEFINITIONS)


def test_any_stamped_message_with_a_number_is_a_meter():
    source = MeterSource(**{**POWER, "type": OTHER, "value_path": "measurement.power"})
    ingest = MeterIngest(source, WIDER)
    inner = WIDER.types["acme_msgs/msg/Measurement"]
    # notes of different length change the layout; the order of arrival must stay
    rows = [
        bytes(
            WIDER.serialize_cdr(
                WIDER.types[OTHER](header(1.0 + i), inner(float(i), np.zeros(2), "x" * (i % 3))),
                OTHER,
            )
        )
        for i in range(6)
    ]
    block = ingest.step([RawBatch.from_messages("/p", OTHER, [SECOND] * 6, rows)])
    assert block.power.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert block.stamp_ns.tolist() == [SECOND * (1 + i) for i in range(6)]
    malformed = ingest.step([RawBatch.from_messages("/p", OTHER, [0], [rows[0][:-9]])])
    assert malformed is None
    assert ingest.rejections.rejected == {"malformed": 1}
    assert ingest.rejections.balanced


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("phases[1].power", [20.0, np.nan]),
        ("phases[0].power + phases[1].power + standby", [35.0, np.nan]),
        ("phases[0].power + standby", [15.0, 45.0]),
    ],
)
def test_elements_of_arrays_are_read_and_added(path, expected):
    kind = "acme_msgs/msg/Phases"
    source = MeterSource(**{**POWER, "type": kind, "value_path": path})
    ingest = MeterIngest(source, WIDER)
    phase = WIDER.types["acme_msgs/msg/Measurement"]
    rows = [
        bytes(
            WIDER.serialize_cdr(
                WIDER.types[kind]([phase(power, np.zeros(1), "") for power in powers], 5.0), kind
            )
        )
        for powers in ([10.0, 20.0, 30.0], [40.0])
    ]
    block = ingest.step([RawBatch.from_messages("/p", kind, [SECOND, 2 * SECOND], rows)])
    known = [value for value in expected if np.isfinite(value)]
    assert block.power.tolist() == known
    assert ingest.rejections.rejected["not_finite"] == 2 - len(known)  # an array that is too short
    assert ingest.rejections.balanced


def test_a_message_without_header_is_stamped_by_its_receipt_or_refused():
    plain = {**POWER, "type": "acme_msgs/msg/Plain", "value_path": "watts"}
    assert MeterIngest(MeterSource(**plain), WIDER).step([]) is None
    with pytest.raises(ParameterError, match="stamp_source is header"):
        MeterIngest(MeterSource(**plain, stamp_source="header"), WIDER)
    for path, error in (("volts", MessageTypeError), ("watts.x", MessageTypeError)):
        with pytest.raises(error):
            MeterIngest(MeterSource(**{**plain, "value_path": path}), WIDER)
    for path, said in (
        ("measurement.raw", "is an array"),
        ("measurement.note", "is not a number"),
        ("measurement.power[0]", "is not an array"),
        ("measurement.raw[0][1]", "2 indices"),
        ("measurement.power + measurement.power", "adds a number twice"),
    ):
        with pytest.raises(ParameterError, match=said):
            MeterIngest(MeterSource(**{**POWER, "type": OTHER, "value_path": path}), WIDER)
    for path in ("measurement.raw[-1]", "measurement.power + ", "measurement.raw[x]"):
        with pytest.raises(MessageTypeError):
            MeterIngest(MeterSource(**{**POWER, "type": OTHER, "value_path": path}), WIDER)
    with pytest.raises(MessageTypeError, match="unknown"):
        MeterIngest(MeterSource(**{**POWER, "type": "no/msg/Such", "value_path": "x"}))


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"unit": "W"}, "unit given for PowerReading"),
        ({"location": "grid", "interval": 1.0}, "location, interval given for PowerReading"),
        ({"type": FLOAT64, "unit": "W", **GRID}, "meaning is by_type, which Float64"),
        ({"type": FLOAT64, "meaning": "instantaneous", **GRID}, "unit is by_type, which Float64"),
        ({"type": FLOAT64, "unit": "W", "meaning": "instantaneous"}, "location is by_type"),
        ({**POWER, "quantity": "energy"}, "quantity is energy but unit is W"),
        ({**POWER, "meaning": "cumulative"}, "meaning is cumulative but the reading is a power"),
        ({**COUNTER, "meaning": "instantaneous"}, "instantaneous but the reading is an energy"),
        ({**POWER, "meaning": "mean_over_interval"}, "interval is 0 s"),
        ({**POWER, "interval": 2.0}, "meaning is instantaneous and interval is 2 s"),
        ({**POWER, "stamp_at": "start"}, "stamp_at is start but meaning is instantaneous"),
        ({**POWER, "wraps_at": 1e6}, "wraps_at is given for a power"),
        (
            {**POWER, "stamp_source": "header"},
            "stamp_source is header, which Float64 does not have",
        ),
        ({**POWER, "value_path": "data"}, "value_path is given for Float64"),
        ({**POWER, "type": "acme_msgs/msg/Plain"}, "value_path is empty"),
        ({**POWER, "topic": ""}, "topic is empty"),
        ({**PAIR, "current_topic": ""}, "voltage_topic is given alone"),
        ({**PAIR, "current_topic": "/voltage"}, "are the same"),
        ({**PAIR, "type": BATTERY_STATE}, "a pair of topics of type sensor_msgs/msg/BatteryState"),
        ({**PAIR, "unit": "J"}, "other than power in W"),
        ({**PAIR, "type": POWER_READING}, "voltage_topic given for PowerReading"),
        ({"type": BATTERY_STATE, "unit": "kW"}, "other than power in W"),
    ],
)
def test_settings_that_contradict_each_other_are_refused_in_one_sentence(settings, said):
    with pytest.raises(ParameterError) as caught:
        MeterSource(**settings)
    assert said in str(caught.value)
    assert "; expected" in str(caught.value)


@given(
    seed=st.integers(0, 2**16),
    size=st.integers(1, 40),
    cuts=st.lists(st.integers(0, 40), max_size=8),
)
def test_pairing_does_not_depend_on_the_cutting(seed, size, cuts):
    """Messages in order of receipt, many at the same instant; cut anywhere, ties included."""
    rng = np.random.default_rng(seed)
    times = np.sort(rng.integers(0, 12, size)) / 4
    is_voltage = rng.integers(0, 2, size).astype(bool)
    values = rng.uniform(1, 60, size)
    values[rng.integers(0, size)] = np.nan

    def run(bounds):
        ingest = MeterIngest(MeterSource(**PAIR))
        blocks = []
        for start, stop in zip([0, *bounds], [*bounds, size], strict=True):
            rows = slice(start, stop)
            parts = [
                floats(topic, times[rows][chosen], values[rows][chosen])
                for topic, chosen in (
                    ("/current", ~is_voltage[rows]),
                    ("/voltage", is_voltage[rows]),
                )
            ]
            block = ingest.step([part for part in parts if len(part)])
            assert ingest.rejections.balanced
            if block is not None:
                blocks.append(block)
        readings = [(s, p) for b in blocks for s, p in zip(b.stamp_ns, b.power, strict=True)]
        return readings, ingest.rejections.received, dict(ingest.rejections.rejected)

    assert run([]) == run(sorted(min(cut, size) for cut in cuts))
