"""One recorded run, its meter spoken in every way: the measured energy must stay what it is.

The bundled bag has means over 0.1 s at the grid. The same run is written again with that
meter as messages of another type, and replayed with the parameters that say what they mean.
"""

from functools import cache

import numpy as np
import pytest

from places import ROOT
from robot_energy.bag import BagReader, BagWriter
from robot_energy.bag.cdr.decode import RawBatch
from robot_energy.bag.cdr.types import extended, typestore
from robot_energy.inputs.meter.meter import MeterIngest
from robot_energy.inputs.meter.source import BATTERY_STATE, FLOAT32, FLOAT64, MeterSource
from robot_energy.inputs.sources import Inputs, TemperatureSource
from robot_energy.model import load
from robot_energy.replay.bag_replay import Replay, replay
from robot_energy.replay.setup import ReplaySetup, Topics
from robot_energy.results.replay import replay_report
from robot_energy.timeline.blocks import MeterBlock

BAG = ROOT / "bags" / "kr16_cold"
JOINTS, TEMPERATURES, METER = "/joint_states", "/motor_temperatures", "/power_meter"
SECOND = 10**9
OTHER = "acme_msgs/msg/PowerStamped"
STORE = extended(typestore(), {OTHER: ("ros2msg", "std_msgs/Header header\nfloat64 power\n")})
MODEL = load("kr16")
MEAN = {"meaning": "mean_over_interval", "interval": 0.1, "location": "grid"}


@cache
def recorded() -> tuple[dict[str, RawBatch], MeterBlock]:
    """All messages but those of the meter, and the meter's readings."""
    reader = BagReader(BAG)
    ingest = MeterIngest()
    found = [ingest.step([part[METER]]) for part in reader.parts([METER])]
    readings = MeterBlock.concatenate([block for block in found if block is not None])
    others = {topic: info.msgtype for topic, info in reader.topics.items() if topic != METER}
    rows: dict[str, list[bytes]] = {topic: [] for topic in others}
    times: dict[str, list[int]] = {topic: [] for topic in others}
    for part in reader.parts(list(others)):
        for topic, batch in part.items():
            rows[topic] += [batch.row(i) for i in range(len(batch))]
            times[topic] += batch.log_time_ns.tolist()
    return {
        topic: RawBatch.from_messages(topic, others[topic], times[topic], rows[topic])
        for topic in others
    }, readings


@pytest.fixture(scope="module")
def reference() -> Replay:
    return replay(BAG, MODEL)


@pytest.fixture
def spoken(tmp_path):
    """Replays the run with its meter as other messages, received at its stamps."""

    def run(source: dict, **topics: tuple[str, list[bytes], np.ndarray]) -> Replay:
        others, _ = recorded()
        with BagWriter(tmp_path / "bag", typestore=STORE) as bag:
            for topic, batch in others.items():
                bag.add_topic(topic, batch.msgtype)
            for topic, (msgtype, _, _) in topics.items():
                bag.add_topic(f"/{topic}", msgtype)
            entries = [
                *(
                    (batch.log_time_ns, topic, [batch.row(i) for i in range(len(batch))])
                    for topic, batch in others.items()
                ),
                *((stamp, f"/{topic}", rows) for topic, (_, rows, stamp) in topics.items()),
            ]
            merged = sorted(
                (int(time), topic, row)
                for stamps, topic, rows in entries
                for time, row in zip(stamps, rows, strict=True)
            )
            for time, topic, row in merged:
                bag.write(topic, np.array([time]), [row])
        result = replay(
            tmp_path / "bag", MODEL, ReplaySetup(inputs=Inputs(meter=MeterSource(**source)))
        )
        report = replay_report(result)
        assert report.problems == ()
        assert all(entry.balanced for entry in report.inputs.values())
        return result

    return run


def packed(msgtype, values):
    """Serialised messages of one number each."""
    kind = STORE.types[msgtype]
    return [bytes(STORE.serialize_cdr(kind(float(value)), msgtype)) for value in values]


def header(stamp):
    time = STORE.types["builtin_interfaces/msg/Time"](*divmod(int(stamp), SECOND))
    return STORE.types["std_msgs/msg/Header"](time, "")


def books(result: Replay) -> tuple[float, float, int]:
    found = result.account.comparison
    return found.measured_energy, found.predicted_energy, found.compared_ns


def test_float64_means_are_equal_to_the_bit(spoken, reference):
    _, readings = recorded()
    result = spoken(
        {"type": FLOAT64, "topic": "watts", "unit": "W", **MEAN},
        watts=(FLOAT64, packed(FLOAT64, readings.power), readings.stamp_ns),
    )
    assert books(result) == books(reference)


def test_float32_means_in_kilowatt_from_the_other_side_are_equal_to_single_precision(
    spoken, reference
):
    _, readings = recorded()
    sign = {"sign": "load_negative", "scale": 2.0}
    result = spoken(
        {"type": FLOAT32, "topic": "kilowatts", "unit": "kW", **sign, **MEAN},
        kilowatts=(FLOAT32, packed(FLOAT32, readings.power / -2e3), readings.stamp_ns),
    )
    assert books(result)[0] == pytest.approx(books(reference)[0], rel=1e-7)
    assert books(result)[1:] == books(reference)[1:]


def test_stamped_messages_of_another_package_are_equal_to_the_bit(spoken, reference):
    """Stamped at the start of their interval and one hour late; received whenever."""
    _, readings = recorded()
    kind = STORE.types[OTHER]
    stamp = readings.stamp_ns - SECOND // 10 + 3600 * SECOND
    rows = [
        bytes(STORE.serialize_cdr(kind(header(s), p), OTHER))
        for s, p in zip(stamp, readings.power.tolist(), strict=True)
    ]
    source = {"type": OTHER, "value_path": "power", "topic": "acme/power", "unit": "W", **MEAN}
    source |= {"stamp_at": "start", "stamp_offset": -3600.0}
    result = spoken(source, **{"acme/power": (OTHER, rows, readings.stamp_ns + 7)})
    assert books(result) == books(reference)


@pytest.mark.parametrize(("unit", "joule"), [("J", 1.0), ("Wh", 3600.0), ("kWh", 3.6e6)])
def test_a_fine_counter_is_equal_to_the_microjoule(spoken, reference, unit, joule):
    """Its base is one interval before the first mean; from there both cover the same time."""
    _, readings = recorded()
    energy = 7e7 + np.concatenate([[0.0], np.cumsum(readings.power * 0.1)])
    stamp = np.concatenate([[readings.stamp_ns[0] - SECOND // 10], readings.stamp_ns])
    result = spoken(
        {"type": FLOAT64, "topic": "count", "unit": unit, "location": "grid"},
        count=(FLOAT64, packed(FLOAT64, energy / joule), stamp),
    )
    measured, predicted, compared_ns = books(result)
    assert measured == pytest.approx(books(reference)[0], abs=1e-4)
    assert predicted == pytest.approx(books(reference)[1], abs=1e-6)
    assert compared_ns == books(reference)[2]


@pytest.mark.parametrize("joule", [100.0, 1000.0, 3600.0])
def test_a_coarse_counter_is_right_to_one_count(spoken, reference, joule):
    """Steps of up to 1 Wh, which come every few seconds: as if read exactly, to one count."""
    _, readings = recorded()
    energy = 7e7 + np.cumsum(readings.power * 0.1)
    result = spoken(
        {"type": FLOAT64, "topic": "count", "unit": "J", "location": "grid"},
        count=(FLOAT64, packed(FLOAT64, np.floor(energy / joule) * joule), readings.stamp_ns),
    )
    measured, _, compared_ns = books(result)
    missing = (books(reference)[2] - compared_ns) / SECOND
    assert 0 < missing < 2 * joule / readings.power.min() + 0.2
    used = np.interp(compared_ns / books(reference)[2], [0, 1], [0, books(reference)[0]])
    assert measured == pytest.approx(used, abs=2 * joule + 0.1 * used)
    assert measured <= books(reference)[0] + joule
    assert measured % joule == pytest.approx(0.0, abs=1e-3)


def test_voltage_and_current_give_the_same_energy_within_the_sampling(spoken, reference):
    """Instants in place of means: trapezoids over the same points, 1 % of a run of 36 s."""
    _, readings = recorded()
    volt = 560.0 + 20.0 * np.sin(np.arange(len(readings)))
    result = spoken(
        {"type": FLOAT64, "voltage_topic": "volt", "current_topic": "ampere", "location": "grid"},
        volt=(FLOAT64, packed(FLOAT64, volt), readings.stamp_ns),
        ampere=(FLOAT64, packed(FLOAT64, readings.power / volt), readings.stamp_ns),
    )
    points = result.meter.rejections
    assert (points.received, dict(points.rejected)) == (2 * len(readings), {})
    assert books(result)[0] == pytest.approx(books(reference)[0], rel=0.01)
    power = readings.power[:-1]
    trapezoid = float(((power[1:] + power[:-1]) / 2 * np.diff(readings.stamp_ns[:-1])).sum()) / 1e9
    assert books(result)[0] == pytest.approx(trapezoid, rel=0.005)


def test_a_battery_gives_the_energy_of_its_bus_within_the_sampling(spoken, reference):
    _, readings = recorded()
    kind = STORE.types[BATTERY_STATE]
    nan, none = float("nan"), np.empty(0, dtype=np.float32)
    rows = []
    for stamp, power in zip(readings.stamp_ns.tolist(), readings.power.tolist(), strict=True):
        fields = (header(stamp), 48.0, nan, -power / 48.0, nan, nan, nan, nan)
        message = kind(*fields, 0, 0, 0, True, none, none, "", "")
        rows.append(bytes(STORE.serialize_cdr(message, BATTERY_STATE)))
    result = spoken(
        {"type": BATTERY_STATE, "topic": "battery"},
        battery=(BATTERY_STATE, rows, readings.stamp_ns),
    )
    assert books(result)[0] == pytest.approx(books(reference)[0], rel=0.01)
    assert replay_report(result).comparison.meter_location == "dc_bus"
    assert books(result)[1] < books(reference)[1]  # without the losses before the bus


def test_a_meter_of_another_clock_is_named_and_the_run_still_replayed(spoken):
    _, readings = recorded()
    result = spoken(
        {"type": FLOAT64, "topic": "watts", "unit": "W", "stamp_offset": -600.0, **MEAN},
        watts=(FLOAT64, packed(FLOAT64, readings.power), readings.stamp_ns),
    )
    (note,) = [note for note in replay_report(result).notes if "stamp_offset" in note]
    assert "behind those of the joint states" in note
    assert float(note.rsplit(" ", 1)[1]) == pytest.approx(600.0, abs=1.0)


def test_a_wrong_unit_is_asked_about_and_not_converted(spoken, reference):
    _, readings = recorded()
    result = spoken(
        {"type": FLOAT64, "topic": "kilowatts", "unit": "W", **MEAN},
        kilowatts=(FLOAT64, packed(FLOAT64, readings.power / 1000), readings.stamp_ns),
    )
    assert any(note.endswith("is its unit kW?") for note in replay_report(result).notes)
    assert books(result)[0] == pytest.approx(books(reference)[0] / 1000, abs=1e-3)


def test_megawatts_are_refused_and_the_unit_is_asked_about(spoken):
    _, readings = recorded()
    result = spoken(
        {"type": FLOAT64, "topic": "watts", "unit": "kW", **MEAN},
        watts=(FLOAT64, packed(FLOAT64, readings.power), readings.stamp_ns),
    )
    refused = int((readings.power > 1000).sum())
    said = f"{refused} of {len(readings)} readings of the meter state or imply more than max_power"
    assert any(said in note for note in replay_report(result).notes)


def test_a_meter_that_the_bag_lacks_is_noted():
    inputs = Inputs(meter=MeterSource(type=FLOAT64, topic="w", unit="W", **MEAN))
    result = replay(BAG, MODEL, ReplaySetup(inputs=inputs))
    notes = replay_report(result).notes
    assert "the bag has no w: the meter is not read" in notes
    assert replay_report(result).topics.meter is None
    assert any(note.startswith("/power_meter is not read") for note in notes)
    named = replay(BAG, MODEL, ReplaySetup(topics=Topics(meter="/power_meter"), inputs=inputs))
    assert replay_report(named).topics.meter == "/power_meter"


def test_temperatures_that_the_bag_has_under_another_name_are_noted():
    inputs = Inputs(temperature_sources={"t": TemperatureSource(topic="t")})
    notes = replay_report(replay(BAG, MODEL, ReplaySetup(inputs=inputs))).notes
    assert any(note.startswith("/motor_temperatures is not read") for note in notes)
    none = ReplaySetup(inputs=Inputs(temperature_sources={}))
    assert "/motor_temperatures" not in "".join(replay_report(replay(BAG, MODEL, none)).notes)
