"""The books, where the meter shows up late."""

import numpy as np
import pytest

from accounts import NAMES, steady
from robot_energy.accounting.account import EnergyAccount
from robot_energy.pipeline import EnergyPipeline
from robot_energy.timeline.blocks import MeterBlock, MeterLocation, MeterMeaning
from robots import joint_block, one_wheel

# The wheel at 2 rad/s draws 38 W on the DC bus and 68 W from the grid (see logbook).
TIME = 1.7e9 + np.arange(3001) / 100.0  # 30 s
END_NS = round(TIME[-1] * 1e9)
READING = MeterBlock(
    np.array([END_NS]),
    np.array([40.0]),
    np.array([np.nan]),
    np.array([30.0]),
    MeterMeaning.MEAN_OVER_INTERVAL,
    MeterLocation.DC_BUS,
)


@pytest.mark.parametrize("pieces", [1, 3, 30])
def test_a_first_reading_that_comes_late_is_compared_at_its_own_place(pieces: int) -> None:
    """One mean over the whole run, at its end: what was predicted before must be bus power."""
    pipeline = EnergyPipeline(one_wheel())
    parts = np.array_split(np.arange(len(TIME)), pieces)
    position = 2.0 * (TIME - TIME[0])[:, None]
    block = joint_block(TIME, position, np.full_like(position, 2.0))
    for rows in parts:
        pipeline.step(block[rows], meter=READING if rows is parts[-1] else None)
    pipeline.flush()
    books = pipeline.account.comparison
    assert books.compared_ns == pytest.approx(30e9, abs=1e3)
    assert books.predicted_energy == pytest.approx(38.0 * 30.0, rel=1e-6)
    assert books.measured_energy == pytest.approx(40.0 * 30.0, rel=1e-6)


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("stage", ["registers.add", "shaft.step", "counts.count", "_averager.step"])
def test_a_fault_in_the_middle_books_nothing_of_the_block(stage, first, monkeypatch):
    """Energy and time are those of a run in which these samples never came."""
    blocks = [steady(begin, begin + 1.0, 500.0) for begin in (10.0, 11.01, 12.02)]
    account, reference = EnergyAccount(len(NAMES)), EnergyAccount(len(NAMES))
    for each in (account, reference):
        for block in blocks[:first]:
            each.step(block)
    before = account.totals()

    def fail(*arguments):
        raise ZeroDivisionError

    owner, name = stage.split(".")
    with monkeypatch.context() as faulty:
        faulty.setattr(getattr(account, owner), name, fail)
        with pytest.raises(ZeroDivisionError):
            account.step(blocks[1])
    assert account.totals() == before
    reference.interrupt()
    for each in (account, reference):
        each.step(blocks[2])
    assert account.totals() == reference.totals()
    assert account.registers.time == reference.registers.time
    counts, known = account.counts, reference.counts
    assert (counts.samples, counts.quality) == (known.samples, known.quality)
    assert (counts.phase_ns == known.phase_ns).all()
