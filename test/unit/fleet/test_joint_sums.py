"""Sums of a bag against the plant that made it."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from robot_energy.condition.wear_records import FEATURES
from robot_energy.foundation.units import HOUR_NS
from robot_energy.model import load
from robot_energy.model.figure import Figure
from robot_energy.model.friction_laws import (
    FRICTION_LAWS,
    FrictionLaw,
    LawEntry,
    register_friction_law,
)
from robot_energy.model.payload import payload
from robot_energy.physics.friction import ViscousLaw
from robot_energy.timeline.blocks import Learning
from robot_energy_fleet.bag_joints import (
    COLUMNS,
    MEASURED,
    NODES,
    NODES_DEGC,
    SIGN,
    VISCOUS,
    JointSums,
    bag_figures,
    gram_of,
)
from robot_energy_fleet.bag_sums import HourSums
from robot_energy_fleet.identify import fit_merged, score
from robot_energy_fleet.merged_laws import JointBags, without_nuisances
from robot_energy_identify.stats.systematic import SensorLimits
from robot_energy_plan.motion import Program
from robot_energy_rig import RigConfig, VirtualRig, load_profile
from robot_energy_studies.learning_study import joint_block, pipeline_of, work

MODEL, PROFILE = load("kr16"), load_profile("kr16")
EXACT = SensorLimits(torque=0.0, thermometer=0.0, bodies=0.0)


def run(
    config, seconds=60.0, degc=40.0, mass=None, cut=None, program=None, start_ns=10**18, rate=100.0,
    sensed=True,
):  # fmt: skip
    """The accumulators after a while of the rig, cut into steps of so many samples."""
    rig = VirtualRig(
        PROFILE, program or work(PROFILE, 3, 8), config, 1, degc, degc, start_ns, rate_hz=rate
    )
    if mass is not None:
        body = MODEL.payload[0]
        rig.change(payload=[payload(body.link, mass, body.centre_of_mass, body.inertia)])
    pipeline = pipeline_of(MODEL, Learning.OBSERVE, True)
    sums, hours = JointSums(MODEL), HourSums()
    pipeline.account.on_reading = lambda ns: hours.take(pipeline.account)
    output = rig.step(round(seconds * rate))
    joints = joint_block(output.joints)
    size = len(joints)
    for first in range(0, size, cut or size):
        begin = first == 0
        part = joints[slice(first, first + (cut or size))]
        found = pipeline.step(
            part, output.temperatures if begin and sensed else None, output.meter if begin else None
        )
        sums.take(found)
    sums.take(pipeline.flush())
    hours.take(pipeline.account)
    return sums, hours, pipeline


def bags(parts, joint):
    gram = np.array([sums.grams[joint] for sums in parts])
    rows = np.array([sums.rows[joint] for sums in parts])
    with np.errstate(invalid="ignore"):
        degc = np.array([sums.heat[joint] / sums.warm_rows[joint] for sums in parts])
    number = np.arange(len(parts))
    return JointBags("axis", without_nuisances(gram), rows, degc, number, number)


def test_coulomb_and_viscous_friction_are_those_of_the_plant():
    parts = [run(RigConfig.plain(), degc=degc)[0] for degc in (30.0, 40.0)]
    fit = fit_merged(bags(parts, 0), EXACT, False, "")
    viscous = PROFILE.viscous_40[0] * PROFILE.lubricant[0].friction_factor(60.0)
    assert fit.coulomb == pytest.approx(PROFILE.coulomb[0], rel=0.02)
    assert fit.viscous == pytest.approx(viscous, rel=0.02)


def test_the_law_over_temperature_is_found_on_temperatures_it_has_not_seen():
    config = RigConfig.plain().having("lubricant_temperature")
    parts = [run(config, degc=degc)[0] for degc in (20.0, 28.0, 36.0, 44.0, 52.0, 60.0)]
    joint = bags(parts, 1)
    fit = fit_merged(joint, EXACT, False, "")
    assert fit.chosen != "constant"
    oil = PROFILE.lubricant[1]
    for point in fit.points:
        true = PROFILE.viscous_40[1] * oil.friction_factor(point.motor_temperature_degc)
        assert point.viscous == pytest.approx(true, rel=0.05)
    assert fit.errors["exponential"].rms < 0.5 * fit.errors["constant"].rms
    assert score(joint, fit.law, fit.coulomb).rms < score(joint, None, 0.0).rms


def test_a_law_of_bags_without_temperature_has_no_range():
    """The sums are at the fallback, which no sensor has measured."""
    for sensed in (True, False):
        parts = [run(RigConfig.plain(), start_ns=start, sensed=sensed) for start in (1, 10**12)]
        fit = fit_merged(bags([one[0] for one in parts], 1), EXACT, False, "")
        sums, _, pipeline = parts[0]
        degc = sums.table(pipeline.condition.wear)[1]["motor_temperature_degc"]
        if sensed:
            assert fit.law.fitted_degc[0] < degc < fit.law.fitted_degc[1]
            assert "below 6 K" in fit.warnings[0]
        else:
            assert fit.law.fitted_degc is degc is None
            assert "no motor temperature is known" in fit.warnings[0]


class Line(LawEntry):
    """fv = at_zero + slope T."""

    law: Literal["line"]
    at_zero: Figure
    slope: Figure


def line_curve(entry):
    at_zero, slope = entry.at_zero.value, entry.slope.value
    return ViscousLaw(0.0, 100.0, lambda t: at_zero + slope * t, lambda t: np.full(t.shape, np.nan))


def line_fit(merged):
    fit = merged.fit(np.column_stack([np.ones(NODES), NODES_DEGC]), ("at zero", "slope"))
    at_zero, slope = (Figure(value=float(one), tag="identified") for one in fit.values[1:])
    return Line(law="line", at_zero=at_zero, slope=slope), fit


@pytest.mark.parametrize("fitted", [True, False])
def test_a_law_of_a_user_is_fitted_to_a_fleet(fitted):
    config = RigConfig.plain().having("lubricant_temperature")
    joint = bags([run(config, degc=degc)[0] for degc in (30.0, 35.0, 40.0)], 1)
    kind = FrictionLaw(name="line", label="line", line="a line", entry=Line, curve=line_curve)
    register_friction_law(replace(kind, merged_fit=line_fit) if fitted else kind)
    try:
        fit = fit_merged(joint, EXACT, False, "")
    finally:
        FRICTION_LAWS.remove("line")
    if not fitted:
        assert "no line law, because it has no fit to the sums of a fleet" in " ".join(fit.warnings)
        assert "line" not in fit.laws
        return
    law, oil = line_curve(fit.laws["line"]), PROFILE.lubricant[1]
    for degc in (30.0, 40.0):
        true = PROFILE.viscous_40[1] * oil.friction_factor(degc)
        assert law.viscous(np.array(degc)) == pytest.approx(true, rel=0.05)
    assert fit.errors["line"].rms < fit.errors["constant"].rms


def test_a_heavier_payload_is_a_mass_and_no_friction():
    figures = [
        bag_figures(sums.grams[None], sums.rows[None])
        for sums in (run(RigConfig.plain(), mass=mass)[0] for mass in (15.0, 18.0))
    ]
    assert figures[1].mass[0] - figures[0].mass[0] == pytest.approx(3.0, abs=0.15)
    change = figures[1].multiplier / figures[0].multiplier
    assert change == pytest.approx(1.0, abs=0.02)


def test_sums_do_not_depend_on_how_samples_are_cut():
    whole, hours, _ = run(RigConfig())
    cut, cut_hours, _ = run(RigConfig(), cut=37)
    assert np.array_equal(cut.rows, whole.rows)
    np.testing.assert_allclose(cut.grams, whole.grams, rtol=1e-9, atol=1e-9)
    assert cut_hours.table() == hours.table()


def test_a_row_holds_plain_values_that_give_the_sums_back():
    sums, _, pipeline = run(RigConfig())
    row = sums.table(pipeline.condition.wear)[2]
    gram = gram_of(row["friction_sums"])
    assert gram.shape == (COLUMNS, COLUMNS)
    assert np.array_equal(gram, sums.grams[2])
    assert gram[SIGN, SIGN] == row["friction_rows"]  # the square of a sign is 1
    assert row["motion_time"] == pytest.approx(row["friction_rows"] * 0.04, rel=0.2)
    assert 35.0 < row["motor_temperature_degc"] < 45.0
    assert len(row["wear_features"]) == FEATURES * len(row["wear_excess"])
    assert gram[VISCOUS, MEASURED].sum() > 0.0  # friction takes power


def test_hours_hold_the_energy_of_the_registers():
    _, hours, pipeline = run(RigConfig(), start_ns=HOUR_NS * 500_000 - 30 * 10**9)
    rows = hours.table()
    assert [row["hour_ns"] // HOUR_NS for row in rows] == [499_999, 500_000]
    assert rows[0]["observed_ns"] == pytest.approx(30e9, abs=0.2e9)
    drawn = pipeline.account.registers.microjoule[0]
    assert sum(row["predicted_import_microjoule"] for row in rows) == drawn
    assert all(row["standby_ns"] == 0 for row in rows)


def at_rest(seconds, start_ns=10**18):
    limits = PROFILE.motion_limits(PROFILE.mechanics()[0])
    still = Program(np.zeros((1, 6)) + np.array([0, -1.5, 1.5, 0, 0.5, 0]), limits, 1.0)
    return run(RigConfig(), seconds=seconds, program=still, rate=20.0, start_ns=start_ns)[1]


def test_a_rest_over_an_hour_is_standby_of_the_hour_in_which_it_lasts_a_minute():
    """As in a history: 50 s of it lie in the hour before, so standby exceeds what is observed."""
    first, second = at_rest(70.0, HOUR_NS * 500_000 - 50 * 10**9).table()
    assert first["standby_ns"] == 0
    assert second["observed_ns"] == pytest.approx(20e9, abs=0.2e9)
    assert second["standby_ns"] == pytest.approx(70e9, abs=0.2e9)


def test_rest_of_a_minute_is_standby_from_its_beginning():
    short, long = at_rest(50.0), at_rest(90.0)
    assert sum(row["standby_ns"] for row in short.table()) == 0
    assert sum(row["standby_ns"] for row in long.table()) == pytest.approx(90e9, abs=1e9)
    for row in (*long.table(), *short.table()):
        assert row["motion_ns"] == 0
    for row in long.table():
        assert row["standby_microjoule"] == row["predicted_import_microjoule"]
