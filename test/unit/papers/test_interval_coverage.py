"""Coverage of intervals: what is true of a drawn plant, and how it is counted."""

from dataclasses import replace

import numpy as np
import pytest
from interval_coverage import disjoint

from robot_energy.physics.friction import viscous_law
from robot_energy_identify.run_all import identify_everything, in_turns
from robot_energy_studies import interval_coverage as study
from robot_energy_studies.interval_coverage import Judged, coverages


@pytest.fixture(scope="module")
def plant():
    """A drawn KR 16 whose sensors are exact, two recordings of it, and what was identified."""
    return study.DrawnPlant.of("kr16", 2, hard=False)


@pytest.fixture(scope="module")
def bags(plant, tmp_path_factory):
    config = plant.config.without("temperature_error", "meter_error", "temperature_sensor")
    exact = replace(config.sensors, torque_constant_error=0.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "SECONDS", 20.0)
        folder = tmp_path_factory.mktemp("plant")
        return replace(plant, config=replace(config, sensors=exact)).recorded(folder)


@pytest.fixture(scope="module")
def result(plant, bags):
    return identify_everything(bags, plant.given_model(), ("capacitor", "thermal"), strict=False)


def test_with_exact_sensors_the_figures_are_those_that_are_called_true(plant, result):
    figures = plant.judged(result)
    by_group = {group: [e for e in figures if e.group == group] for group in study.GROUPS}
    assert len(by_group["bodies"]) == 40
    assert len(by_group["Coulomb"]) == 6
    assert len(by_group["viscous"]) == 24
    assert len(by_group["constants"]) == 2
    shares = {"Coulomb": 0.01, "viscous": 0.05, "constants": 0.01, "copper": 0.1}
    for group, share in shares.items():
        for entry in by_group[group]:
            assert entry.value == pytest.approx(entry.truth, rel=share), entry.name
    assert np.mean([entry.held for entry in by_group["bodies"]]) > 0.9


@pytest.mark.long
def test_a_further_recording_gives_no_disjoint_intervals(plant, bags, result):
    three = identify_everything(
        bags[:3], plant.given_model(), ("capacitor", "thermal"), strict=False
    )
    fewer, more = plant.judged(three), plant.judged(result)
    count, apart = disjoint(fewer, more)
    assert count > 60
    assert apart == ()
    narrow = [replace(entry, std=0.01 * entry.std) for entry in fewer]
    _, apart = disjoint(narrow, [replace(entry, std=0.01 * entry.std) for entry in more])
    assert apart


@pytest.mark.long
def test_cabinet_and_drives_agree_when_the_turns_end(bags, result):
    """Once more, each with the other, the constants stay where they are."""
    steps = {step.subject: step for step in result.steps}
    assert "each with the result of the other" in steps["drives"].notes[-1]
    before = steps["drives"].model.cabinet
    base = steps["friction"].model
    _, again = in_turns(steps["cabinet"], steps["drives"], bags, base, "again")
    for name in ("loss_grid", "loss_dc"):
        old, new = getattr(before, name), getattr(again.model.cabinet, name)
        assert new.value == pytest.approx(old.value, abs=max(0.3 * (old.std or 0.0), 0.2))


@pytest.mark.long
def test_a_split_has_the_deviation_of_both_parts(result):
    fit, cabinet = result.step("cabinet").found, result.model.cabinet
    assert cabinet.loss_grid.tag == cabinet.loss_dc.tag == "identified"
    both = np.hypot(fit.hold.std, fit.generating.std)
    assert fit.parts["loss_dc"]["scatter"] == pytest.approx(both)
    assert fit.generating.std > 0.0
    # one meter: its gain counts for the difference of both readings
    gain = study.LIMITS.std.meter
    reading = fit.hold.moves["meter"] / gain
    assert reading > fit.hold.power  # what the drives take at rest is in it
    difference = gain * (reading - fit.generating.power)
    assert fit.parts["loss_dc"]["meter"] == pytest.approx(difference)


def test_sensors_of_one_plant_have_the_same_constant_errors(plant):
    law = viscous_law(plant.given_model().joints[0].friction.viscous)
    assert law.lower_degc < 30.0 < law.upper_degc
    profile, config, program = plant.profile, plant.config, study.program_of(plant.profile, 0)
    first, second, other = (
        study.VirtualRig(profile, program, config, seed, 30.0, 30.0, device_seed=device)
        for seed, device in ((1, 7), (2, 7), (2, 8))
    )
    one, two, three = (rig.step(500).joints.measured_motor_torque for rig in (first, second, other))
    assert not np.array_equal(one, two)
    np.testing.assert_allclose(one.mean(axis=0), two.mean(axis=0), rtol=2e-2, atol=5e-3)
    assert np.abs(three.mean(axis=0) / one.mean(axis=0) - 1.0).max() > 5e-3


def test_intervals_are_counted_by_group():
    """Errors of 1, -3 and 0 deviations, one without a deviation."""
    first = [Judged("Coulomb", "a", 1.0, 1.1, 0.1), Judged("Coulomb", "b", 1.0, 0.7, 0.1)]
    second = [Judged("Coulomb", "a", 2.0, 2.0, 0.1), Judged("DC link", "e", 1.0, 1.0, np.nan)]
    coulomb, link = coverages([first, second])
    assert (coulomb.figures, coulomb.repetitions) == (3, 2)
    assert coulomb.share == pytest.approx(2 / 3)
    assert coulomb.deviations == pytest.approx((10 / 3) ** 0.5)
    assert (link.figures, link.share) == (1, 0.0)
