"""Messages of the monitors, and the page of a bundled bag, for the tests of the energy page."""

from functools import cache
from pathlib import Path

import numpy as np

from robot_energy.bag.cdr import Encoder, RawBatch, stamp_columns
from robot_energy.messages.fields import ENERGY_REGISTERS
from robot_energy.messages.power import POWER_STATE
from robot_energy.model import load
from robot_energy.replay.bag_replay import replay
from robot_energy.replay.setup import ReplaySetup
from robot_energy_report.page.recording import RecordedPage
from robot_energy_report.page.settings import PageSettings

BAGS = Path(__file__).resolve().parent.parent / "bags"
JOINTS = ("joint_a1", "joint_a2")
START_NS = 1_700_000_000_000_000_000


@cache
def encoder_of(msgtype, names):
    arrays = ("auxiliary", "auxiliary_states") if msgtype == ENERGY_REGISTERS else ("auxiliary",)
    constants = {"model_id": "abc", "joints.name": names}
    return Encoder(msgtype, constants, dict.fromkeys(arrays, 0))


def zeros(encoder, n):
    """All fields at zero, without auxiliary loads."""
    nothing = np.empty((n, 0), dtype=np.uint8)
    exact = {name: 0 for name in encoder.fields if "microjoule" in name or name.endswith("_ns")}
    return {
        name: nothing if name.startswith("auxil") else exact.get(name, 0.0)
        for name in encoder.fields
    }


def batch(msgtype, rows):
    return RawBatch.from_messages(
        "topic", msgtype, [0] * len(rows), [row.tobytes() for row in rows]
    )


def power_states(seconds, power, names=JOINTS, period=0.1, measured=None, **values):
    """Power states at the ends of their periods, all of it friction of the first joint."""
    ends = START_NS + (np.asarray(seconds) * 1e9).astype(np.int64)
    n, power = len(ends), np.broadcast_to(np.asarray(power, dtype=float), len(ends))
    encoder = encoder_of(POWER_STATE, tuple(names))
    columns = zeros(encoder, n)
    columns |= {
        name: np.uint32(0) if name == "quality" else np.uint8(0)
        for name in ("phase", "meter_location", "band", "quality")
    }
    friction = np.zeros((n, len(names)))
    friction[:, 0] = power
    columns |= {
        **stamp_columns(ends),
        "period": period,
        "predicted_grid_power": power,
        "measured_power": np.nan if measured is None else measured,
        "predicted_power_at_meter": np.nan if measured is None else power,
        "joints.friction_power": friction,
    }
    return batch(POWER_STATE, encoder.encode(columns | values, n))


def registers(energy, stamp=10.0, start=0.0, names=JOINTS, **values):
    """One register message; all of the energy is friction of the first joint."""
    encoder = encoder_of(ENERGY_REGISTERS, tuple(names))
    columns = zeros(encoder, 1)
    friction = np.zeros((1, len(names)))
    friction[0, 0] = energy
    columns |= {
        **stamp_columns(np.array([START_NS + round(stamp * 1e9)])),
        **stamp_columns(np.array([START_NS + round(start * 1e9)]), "energy_start"),
        **stamp_columns(np.array([0]), "minute"),
        "meter_location": np.uint8(0),
        "persisted": True,
        "observed_time": stamp - start,
        "band": np.uint8(0),
        "gap_count": np.uint64(0),
        "predicted_import_energy": energy,
        "measured_energy": np.nan,
        "predicted_energy_at_meter": np.nan,
        "joints.friction_energy": friction,
    }
    return batch(ENERGY_REGISTERS, encoder.encode(columns | values, 1))


def recorded(bag="kr16_cold", settings=None, auxiliary=None):
    """The page of a bundled bag, and the replay that filled it."""
    model = load("kr16").changed(auxiliary=auxiliary)
    page = RecordedPage(bag, model, settings or PageSettings())
    result = replay(
        BAGS / bag, model, ReplaySetup.of({"power_period": page.period}), on_output=page.take
    )
    page.finish(result)
    return page, result
