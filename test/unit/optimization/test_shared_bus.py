"""Robots on one DC bus: programs in a common cycle, and bags recorded together."""

import numpy as np
import pytest

import robot_energy as re
from places import ROOT
from robot_energy.foundation.errors import MotionError
from robot_energy.model import load
from robot_energy.model.figure import Figure, PositiveFigure
from robot_energy.model.schema import CabinetFan, Capacitor
from robot_energy_cli.main import main
from robot_energy_plan.shared_bus import drawn, level_starts

MOVES = ROOT / "src/examples/programs/kr16_pick_and_place.yaml"
COLD, WARM = ROOT / "bags/kr16_cold", ROOT / "bags/kr16_warm"


def test_braking_of_one_is_put_where_the_other_drives():
    square = np.where(np.arange(100) < 50, 900.0, -700.0)
    found = level_starts([square, square], 10.0, drawn)
    assert found.together == pytest.approx(900.0)  # 1800 W for half the time
    assert found.start[1] == pytest.approx(5.0)
    assert found.least == pytest.approx(200.0)
    # k of 100 steps apart: both drive in 50 - k steps, one in 2 k of them, at 1800 and 200 W
    apart = np.minimum(np.arange(100), 100 - np.arange(100))
    assert found.any_start == pytest.approx((1800.0 * (50 - apart) + 400.0 * apart).mean() / 100)


def test_programs_in_a_common_cycle():
    found = re.shared_bus([MOVES, MOVES], "kr16", 40.0)
    report = found.report
    alone = re.predict(MOVES, "kr16", 40.0).energy
    assert report.robots[0].energy == pytest.approx(alone.net, rel=1e-3)
    assert report.robots[0].brake_energy == pytest.approx(alone.brake, rel=0.02)
    assert report.saved == pytest.approx(0.0, abs=1e-6)  # both do the same at the same time
    assert 0 < report.saved_any_start < report.saved_best <= 2.001 * report.robots[0].brake_energy
    assert report.robots[1].start > 0
    assert report.brake_energy == pytest.approx(report.brake_energy_apart)


@pytest.mark.parametrize(
    ("motions", "given", "on_above_degc", "off"),
    [
        ([MOVES, MOVES], {"temperature": 40.0}, 0.0, 99.0),
        ([COLD, WARM], {"same_start": True}, 99.0, -99.0),
    ],
)
def test_a_fan_takes_its_power_from_own_supplies_and_from_the_bus(
    motions, given, on_above_degc, off
):
    """By temperatures of motors in a program, and by readings in recordings, less their errors."""
    model = load("kr16")
    power = PositiveFigure(value=100.0, tag="assumed")
    above = Figure(value=on_above_degc, tag="assumed")
    fan = CabinetFan(power=power, on_above_degc=above, thermometers=(off,) * 6)
    with_fan = model.changed(cabinet=model.cabinet.model_copy(update={"fan": fan}))
    old, new = (re.shared_bus(motions, one, **given).report for one in (model, with_fan))
    both = pytest.approx(2 * 100.0 * old.duration, rel=1e-6)
    assert new.energy - old.energy == both
    assert new.energy_apart - old.energy_apart == both
    assert new.saved == pytest.approx(old.saved, abs=1e-6)
    assert new.peak_power == pytest.approx(old.peak_power + 200.0)


def test_a_robot_waits_until_the_cycle_is_over():
    short, long = (
        re.shared_bus([MOVES, MOVES], "kr16", 40.0, cycle_time=cycle).report
        for cycle in (35.0, 45.0)
    )
    assert long.energy - short.energy == pytest.approx(2 * 10.0 * 400.0, rel=0.02)  # at rest
    with pytest.raises(MotionError, match=r"takes 33\.\d+ s"):
        re.shared_bus([MOVES, MOVES], "kr16", cycle_time=30.0)


def test_starts_with_the_least_energy():
    given = {"cycle_time": 9.0, "level": [MOVES], "one_bus": True}
    found = re.optimize(MOVES, "kr16", 40.0, **given).report
    bus = found.shared_bus
    assert [one.start for one in found.starts] == [one.start for one in bus.robots]
    assert found.supply.mean_power == pytest.approx((bus.energy_apart - bus.saved_best) / 9.0)
    with pytest.raises(MotionError, match="no other robot"):
        re.optimize(MOVES, "kr16", 40.0, cycle_time=9.0, one_bus=True)


def with_link(capacitance, tag):
    """The shipped KR 16 with a DC link of 40 J for each mF, its voltages known or not."""
    low, high = (PositiveFigure(value=value, tag=tag) for value in (566.0, 634.0))
    link = Capacitor(
        capacitance=PositiveFigure(value=capacitance, tag="identified", std=0.0),
        nominal_voltage=low,
        chopper_voltage=high,
    )
    model = load("kr16")
    return model.changed(cabinet=model.cabinet.model_copy(update={"capacitor": link}))


def test_links_of_two_models_at_voltages_that_are_assumed_leave_less_room():
    """Known voltages, or links of one model, are in the saving and not in its band."""

    def found(capacitances, tag):
        models = [with_link(one, tag) for one in capacitances]
        return re.shared_bus([COLD, WARM], models).report

    two, one = (2e-3, 2.2e-3), (2e-3, 2e-3)
    known, open_ = found(two, "published"), found(two, "assumed")
    assert open_.saved == known.saved
    assert open_.half > 1.05 * known.half
    assert found(one, "assumed").half == pytest.approx(found(one, "published").half, rel=1e-9)


def test_bags_recorded_together():
    found = re.shared_bus([COLD, WARM], "kr16").report
    for bag, robot in zip((COLD, WARM), found.robots, strict=True):
        energy = re.replay(bag, "kr16").energy
        assert robot.energy == pytest.approx(energy.net, rel=1e-3)
        assert robot.brake_energy == pytest.approx(energy.brake, rel=1e-3)
    less_braked = found.brake_energy_apart - found.brake_energy
    assert found.saved == pytest.approx(less_braked, rel=1e-9)  # nothing else changes
    assert 0 < found.half < found.saved
    with pytest.raises(MotionError, match="not made at one time"):
        re.shared_bus([COLD, ROOT / "bags/kr16_all_topics"], "kr16")


def test_the_command_lays_recordings_of_other_times_upon_each_other(capsys):
    bags = [str(COLD), str(ROOT / "bags/kr16_all_topics")]
    assert main(["shared-bus", *bags, "--model", "kr16"]) == 2
    assert "--same-start" in capsys.readouterr().err
    assert main(["shared-bus", *bags, "--model", "kr16", "--model", "kr16", "--same-start"]) == 0
    said = capsys.readouterr().out
    assert "9.12 s of recordings of all robots" in said
    assert "count as begun at once" in said


def test_what_does_not_fit_is_refused():
    with pytest.raises(MotionError, match="one for each robot"):
        re.shared_bus([MOVES], "kr16")
    with pytest.raises(MotionError, match="recordings alone, or programs"):
        re.shared_bus([MOVES, COLD], "kr16")
    with pytest.raises(MotionError, match="cycle time does not apply to recordings"):
        re.shared_bus([COLD, WARM], "kr16", cycle_time=5.0)
    with pytest.raises(MotionError, match="3 models for 2"):
        re.shared_bus([COLD, WARM], ["kr16"] * 3)
    with pytest.raises(MotionError, match="on one bus they are those of the models"):
        re.shared_bus([COLD, WARM], "kr16", same_start=True, learning="apply")
