"""Friction over temperature: recovered from torque that was made another way."""

import io
import statistics
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console
from scipy.optimize import curve_fit, least_squares

from logbook import mapping, write_csv
from places import ROOT
from robot_energy.foundation.errors import LogFormatError, NotIdentifiableError
from robot_energy.model import load
from robot_energy.physics.friction import viscous_law
from robot_energy.timeline.blocks import EffortMeaning
from robot_energy_identify.data.recordings import read_recording
from robot_energy_identify.friction.friction import fit_friction
from robot_energy_identify.friction.samples import FrictionData, friction_data, friction_data_of_log
from robot_energy_identify.friction.temperature_study import Span, axis_study, temperature_split
from robot_energy_identify.friction_and_thermal import FrictionReport
from robot_energy_identify.plausibility import check_friction
from robot_energy_identify.stats.regression import jackknife
from robot_energy_logs.log_import import open_logs
from robot_energy_report.document import Document
from robot_energy_report.identification import friction_tables
from robot_energy_report.printing import print_document

COULOMB, A, B, C = 0.4, 2e-3, 9e-3, 21.0


def viscous(degc):
    return A + B * np.exp(-degc / C)


def measurement(seed=0, minutes=30, degc=(20.0, 70.0), noise=0.05, law=viscous):
    """An axis that goes back and forth at several speeds while its motor warms up; 5 Hz."""
    random = np.random.default_rng(seed)
    time = np.arange(0, 60 * minutes, 0.2)
    amplitude = np.repeat(random.uniform(30, 300, len(time) // 25 + 1), 25)[: len(time)]
    speed = amplitude * np.sin(2 * np.pi * time / 5.0)
    temperature = np.linspace(*degc, len(time))
    torque = COULOMB * np.sign(speed) + law(temperature) * speed
    return FrictionData(
        "joint_a1",
        speed,
        torque + random.normal(scale=noise, size=len(time)) + 0.02,
        temperature,
        (time // 10.0).astype(np.int64),
        np.zeros(len(time), dtype=np.int64),
        np.empty((len(time), 0)),
    )


def test_the_exponential_law_is_recovered_within_its_deviations():
    fit = fit_friction(measurement())
    assert fit.chosen == "exponential"
    law = fit.law
    assert fit.coulomb == pytest.approx(COULOMB, abs=4 * fit.coulomb_std)
    assert fit.coulomb_std < 0.005
    for figure, truth in ((law.a, A), (law.b, B), (law.c, C)):
        assert figure.value == pytest.approx(truth, abs=4 * figure.std)
        assert figure.std < 0.1 * truth


@pytest.fixture(scope="module")
def short_fits():
    """Of 20 short recordings."""
    return [fit_friction(measurement(seed, minutes=5)) for seed in range(20)]


def test_intervals_of_fc_a_and_c_cover_the_truth(short_fits):
    """Two standard deviations over 20 short recordings: about 95 %."""
    inside = np.zeros(4)
    for fit in short_fits:
        law = fit.laws["exponential"]
        found = np.array([fit.coulomb, law.a.value, law.b.value, law.c.value])
        std = np.array([fit.coulomb_std, law.a.std, law.b.std, law.c.std])
        inside += np.abs(found - [COULOMB, A, B, C]) <= 2.0 * std
    assert (inside >= 17).all(), inside


def test_the_deviation_of_the_law_covers_the_true_curve(short_fits):
    """Two of its standard deviations, over 20 short recordings and the whole fitted range."""
    inside = []
    for fit in short_fits:
        law = fit.laws["exponential"]
        degc = np.linspace(*law.fitted_degc, 20)
        found = viscous_law(law)
        inside.append(np.abs(found.viscous(degc) - (A + B * np.exp(-degc / C))) <= 2 * law.std)
    assert np.mean(inside) >= 0.95
    assert law.std < 0.1 * A


def loaded(share, saturation=np.inf, seed=0, minutes=15):
    """The same axis under a changing load of up to 6 N m, known as the bodies are."""
    data = measurement(seed, minutes)
    rigid = 6.0 * np.sin(np.arange(len(data)) / 17.0)
    torque = share * np.minimum(np.abs(rigid), saturation) * data.sign
    return replace(data, friction_torque=data.friction_torque + torque, rigid=rigid)


def test_friction_by_load_comes_back_with_the_temperature_law():
    fit = fit_friction(loaded(0.06))
    share, std, saturation = fit.load
    assert share == pytest.approx(0.06, abs=3 * std)
    assert std < 0.002
    assert saturation == np.inf
    assert fit.chosen == "exponential"
    assert fit.coulomb == pytest.approx(COULOMB, abs=4 * fit.coulomb_std)
    assert any("by load" in text for text in fit.warnings)
    entry = fit.entry(load("kr16").joints[0].friction, "test")
    assert entry.load_coulomb.value == share
    assert entry.load_coulomb.std == std
    assert entry.load_saturation is None
    # what was found as Coulomb torque without it
    blind = fit_friction(replace(loaded(0.06), rigid=None))
    assert blind.load is None
    assert blind.coulomb > COULOMB + 0.15


def test_friction_by_load_that_saturates_comes_back():
    fit = fit_friction(loaded(0.2, saturation=4.0))
    share, _, saturation = fit.load
    assert saturation == pytest.approx(4.0, abs=0.4)  # the median load
    assert share == pytest.approx(0.2, rel=0.1)
    entry = fit.entry(load("kr16").joints[0].friction, "test")
    assert entry.load_saturation.value == saturation


def test_friction_by_load_that_is_not_there_is_not_written():
    """Over ten recordings without any; a term of an earlier file goes, friction is the whole."""
    for seed in range(10):
        fit = fit_friction(loaded(0.0, seed=seed, minutes=5))
        assert fit.load is None
    before = load("kr16").joints[0].friction
    stated = before.model_copy(update={"load_coulomb": before.coulomb})
    assert fit.entry(stated, "test").load_coulomb is None
    logged = fit_friction(measurement(minutes=5))  # bodies unknown: nothing is said of it
    assert logged.entry(stated, "test").load_coulomb == before.coulomb


def bent(exponent, seed=0, minutes=15, **kinds):
    """The same axis with viscous friction by a power of the speed, which is as before at 120."""
    data = measurement(seed, minutes, **kinds)
    w, fv = data.motor_velocity, viscous(data.motor_temperature_degc)
    power = 120.0 * np.sign(w) * (np.abs(w) / 120.0) ** exponent
    return replace(data, friction_torque=data.friction_torque + fv * (power - w))


@pytest.mark.parametrize("exponent", [0.6, 0.75, 1.3])
def test_a_viscous_exponent_comes_back_with_the_temperature_law(exponent):
    """Within its deviations, and as a fit of all figures at once by scipy says."""
    data = bent(exponent)
    fit = fit_friction(data, "bag")
    found, std, velocity = fit.exponent
    assert found == pytest.approx(exponent, abs=3 * std)
    assert std < 0.02
    assert fit.chosen == "exponential"
    assert fit.coulomb == pytest.approx(COULOMB, abs=4 * fit.coulomb_std)
    assert any("viscous exponent" in text for text in fit.warnings)
    entry = fit.entry(load("kr16").joints[0].friction, "bag")
    assert entry.viscous_exponent.exponent.value == found
    assert entry.viscous_exponent.exponent.std == std
    assert entry.viscous_exponent.velocity.value == velocity
    kept = np.abs(data.motor_velocity) > 0.03 * 300.0

    def error(x):
        w, degc = data.motor_velocity[kept], data.motor_temperature_degc[kept]
        along = (
            x[0] + (x[1] + x[2] * np.exp(-degc / x[3])) * np.abs(w / velocity) ** x[4] * velocity
        )
        return data.friction_torque[kept] - x[5] - np.sign(w) * along

    start, sizes = [0.5, 2e-3, 9e-3, 20.0, 1.0, 0.0], [1.0, 1e-3, 1e-3, 10.0, 1.0, 1.0]
    plain = least_squares(error, start, x_scale=sizes, loss="huber", f_scale=1.345 * 0.05)
    assert found == pytest.approx(plain.x[4], abs=0.5 * std)
    assert fit.coulomb == pytest.approx(plain.x[0], abs=0.5 * fit.coulomb_std)
    law = viscous_law(fit.law)
    for degc in (25.0, 45.0, 65.0):
        scipy = plain.x[1] + plain.x[2] * np.exp(-degc / plain.x[3])
        assert float(law.viscous(degc)) == pytest.approx(scipy, rel=0.003)


def test_a_viscous_exponent_and_friction_by_load_come_back_together():
    data, straight = loaded(0.06), measurement(minutes=15)
    curve = bent(0.7).friction_torque - straight.friction_torque
    fit = fit_friction(replace(data, friction_torque=data.friction_torque + curve))
    assert fit.load[0] == pytest.approx(0.06, abs=3 * fit.load[1])
    assert fit.exponent[0] == pytest.approx(0.7, abs=3 * fit.exponent[1])
    assert fit.coulomb == pytest.approx(COULOMB, abs=3 * fit.coulomb_std)


def test_a_viscous_exponent_that_is_not_there_is_not_written():
    """Over ten recordings of friction in proportion to speed; a term of an earlier file goes."""
    for seed in range(10):
        fit = fit_friction(measurement(seed, minutes=5))
        assert fit.exponent is None
    before = fit_friction(bent(0.6), "bag").entry(load("kr16").joints[0].friction, "bag")
    assert before.viscous_exponent is not None
    assert fit.entry(before, "bag").viscous_exponent is None


def test_a_viscous_exponent_that_gains_too_little_is_not_written():
    """It is surely below 1, but what was held out gains less than 2 %."""
    fit = fit_friction(bent(0.9))
    assert fit.exponent is None
    assert fit.coulomb > COULOMB + 8 * fit.coulomb_std


@pytest.mark.parametrize("second", [0.6, 1.1])
def test_a_viscous_exponent_counts_if_other_recordings_have_it_too(second):
    """Two recordings at one temperature, the longer one with an exponent of 0.6."""
    first, other = (
        bent(exponent, seed, minutes, degc=(30.0, 30.0), noise=0.02)
        for seed, exponent, minutes in ((0, 0.6, 15), (1, second, 5))
    )
    names = ("motor_velocity", "friction_torque", "motor_temperature_degc", "nuisance")
    data = replace(
        first,
        block=np.append(first.block, other.block + first.block[-1] + 1),
        run=np.append(first.run, other.run + 1),
        **{name: np.concatenate([getattr(part, name) for part in (first, other)])
           for name in names},
    )  # fmt: skip
    fit = fit_friction(data)
    assert fit.held_out == "blocks"
    assert (fit.exponent is not None) == (second == 0.6)


def test_the_interval_of_a_viscous_exponent_covers_the_truth():
    """Two standard deviations over 20 short recordings: about 95 %."""
    inside = [0, 0]
    for seed in range(20):
        fit = fit_friction(bent(0.5, seed, minutes=5))
        inside[0] += abs(fit.exponent[0] - 0.5) <= 2.0 * fit.exponent[1]
        inside[1] += abs(fit.coulomb - COULOMB) <= 2.0 * fit.coulomb_std
    assert min(inside) >= 17, inside


def test_a_drift_during_the_measurement_does_not_bias_the_points():
    """The motor warms by 50 K in one go; each point has the friction of its own temperature."""
    for point in fit_friction(measurement(noise=0.0)).points:
        assert point.viscous == pytest.approx(viscous(point.motor_temperature_degc), rel=0.03)


def test_a_block_that_alone_says_a_figure_leaves_a_law_without_covariance(monkeypatch):
    """Whether a matrix is singular is a matter of rounding, so of the processor."""

    def singular(block):
        def covariance(columns, residual, weight):
            scatter, *rest = jackknife(block)(columns, residual, weight)
            # five columns: Coulomb, offset, and three of the law with its scale
            return (np.full_like(scatter, np.inf) if len(scatter) == 5 else scatter, *rest)

        return covariance

    monkeypatch.setattr("robot_energy_identify.stats.regression.jackknife", singular)
    law = fit_friction(measurement()).laws["exponential"]
    assert law.covariance is None
    assert law.c.std is None
    assert law.c.value == pytest.approx(C, rel=0.1)


def test_a_law_that_is_no_exponential_becomes_a_table():
    def humped(degc):
        return 5e-3 + 2e-3 * np.sin(degc / 8.0)

    fit = fit_friction(measurement(law=humped))
    assert fit.chosen == "table"
    inside = np.linspace(25.0, 65.0, 9)
    np.testing.assert_allclose(viscous_law(fit.law).viscous(inside), humped(inside), rtol=0.1)


def test_friction_that_does_not_know_temperature_stays_constant():
    fit = fit_friction(measurement(law=lambda degc: np.full_like(degc, 4e-3)))
    assert fit.chosen == "constant"
    assert fit.law.viscous.value == pytest.approx(4e-3, rel=0.02)


def test_one_temperature_gives_a_constant_and_says_what_to_record():
    fit = fit_friction(measurement(degc=(40.0, 42.0)))
    assert fit.chosen == "constant"
    assert "record it cold and warm" in fit.warnings[0]
    assert fit.law.viscous.value == pytest.approx(viscous(41.0), rel=0.05)
    low, high = fit.law.fitted_degc  # as far as a constant cannot be distinguished from a law
    assert low == pytest.approx(fit.range_degc[1] - 6.0, abs=0.1)
    assert high == pytest.approx(fit.range_degc[0] + 6.0, abs=0.1)


def test_held_out_temperatures_say_the_laws_apart():
    """Noise of 0.05 N m; the held edge of the range costs a little."""
    errors = fit_friction(measurement()).errors
    assert 0.05 < errors["exponential"].rms < 0.08
    assert errors["constant"].rms > 2 * errors["exponential"].rms


def test_held_out_fits_compute_no_deviations(monkeypatch):
    data, asked = measurement(), list[int]()

    def counted(block):
        asked.append(len(block))
        return jackknife(block)

    monkeypatch.setattr("robot_energy_identify.stats.regression.jackknife", counted)
    fit = fit_friction(data)
    assert {"constant", "table", "exponential"} <= set(fit.errors)
    assert 0 < len(asked) <= 2 * len(fit.laws)
    assert len(set(asked)) == 1


def test_an_outlier_in_a_hundred_changes_little():
    data = measurement()
    data.friction_torque[::100] += 20.0
    assert fit_friction(data).coulomb == pytest.approx(COULOMB, abs=0.02)


def test_gravity_as_a_nuisance_is_taken_out():
    data = measurement()
    angle = np.cumsum(data.motor_velocity) * 0.2 / 100
    nuisance = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    loaded = FrictionData(
        data.name,
        data.motor_velocity,
        data.friction_torque + 3.0 * nuisance[:, 0],
        data.motor_temperature_degc,
        data.block,
        data.run,
        nuisance,
    )
    assert fit_friction(loaded).coulomb == pytest.approx(COULOMB, abs=0.02)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"motor_velocity": 0.0}, "moves in 0 of"),
        ({"friction_torque": np.nan}, "no measured torque"),
        ({"motor_velocity": 50.0}, "one speed, 50 rad/s: Coulomb and viscous"),
    ],
)
def test_data_that_cannot_say_friction_are_refused_with_what_to_record(change, words):
    data = measurement(minutes=2)
    for name, value in change.items():
        getattr(data, name)[:] = value
    with pytest.raises(NotIdentifiableError, match=words):
        fit_friction(data)


def test_one_thermal_state_is_held_out_in_time_not_by_temperature():
    """The sensor's two readings split these motions by direction: each fold alone says nothing."""
    data = measurement(minutes=1, degc=(20.0, 20.0))
    degc = np.where(data.motor_velocity > 0, 20.0, 21.0)
    fit = fit_friction(replace(data, motor_temperature_degc=degc))
    assert fit.chosen == "constant"
    assert fit.coulomb == pytest.approx(COULOMB, abs=0.03)
    assert fit.law.viscous.value == pytest.approx(viscous(20.0), rel=0.03)
    assert fit.errors["constant"].rms == pytest.approx(0.05, rel=0.3)  # the noise


def test_the_table_says_of_each_axis_what_was_held_out():
    axes = [fit_friction(measurement(degc=degc)) for degc in ((20.0, 70.0), (40.0, 42.0))]
    assert [fit.held_out for fit in axes] == ["temperatures", "blocks"]
    page, stream = Document(), io.StringIO()
    friction_tables(FrictionReport("measured", tuple(axes), ()), page)
    print_document(page, Console(width=200, file=stream))
    _, table = stream.getvalue().split("RMS torque error on what the fit has not seen")
    first, second = [line for line in table.splitlines() if "joint_a1" in line][:2]
    assert "temperatures" in first
    assert "contiguous blocks" in second


def test_an_axis_without_temperature_has_a_constant_with_a_deviation():
    data = measurement(law=lambda degc: np.full_like(degc, 4e-3))
    unknown = replace(data, motor_temperature_degc=np.full(len(data), np.nan))
    fit = fit_friction(unknown, "bag")
    assert (fit.chosen, list(fit.laws)) == ("constant", ["constant"])
    figure = fit.law.viscous
    assert figure.value == pytest.approx(4e-3, abs=4 * figure.std)
    assert (figure.tag, figure.std < 4e-4) == ("identified", True)
    assert "no motor temperature is known" in fit.warnings[0]
    assert np.isnan(fit.range_degc).all()
    assert fit.errors["constant"].rms == pytest.approx(0.05, rel=0.1)  # the noise
    check_friction([fit])


def one_speed_measurement():
    """Back and forth at one speed, as a noisy encoder sees it, over the same temperatures."""
    data = measurement()
    random = np.random.default_rng(1)
    speed = np.sign(data.motor_velocity) * random.normal(100.0, 0.5, len(data))
    torque = COULOMB * np.sign(speed) + 4e-3 * speed + random.normal(scale=0.05, size=len(data))
    return replace(data, motor_velocity=speed, friction_torque=torque)


def test_one_speed_is_the_reason_where_laws_fail_and_the_constant_row_stays():
    study = temperature_split(one_speed_measurement(), Span(high=45.0), Span(low=50.0))
    assert study.row("constant").rms == pytest.approx(0.05, rel=0.05)
    refused = [text for text in study.refused if "exponential" in text]
    if refused:
        assert "Coulomb and viscous friction cannot be separated" in refused[0]
    warnings = " ".join(fit_friction(one_speed_measurement()).warnings)
    assert "moves at one speed" in warnings


def test_at_one_speed_the_sum_is_written_as_coulomb_torque():
    """Another library's mean of the torque along the motion is the sum: fc + fv w."""
    data = one_speed_measurement()
    fit = fit_friction(data, "bag")
    along = statistics.fmean((data.friction_torque * np.sign(data.motor_velocity)).tolist())
    assert fit.coulomb == pytest.approx(along, abs=2e-3)
    assert fit.coulomb == pytest.approx(COULOMB + 4e-3 * 100.0, abs=4 * fit.coulomb_std)
    assert (fit.law.viscous.value, fit.law.viscous.tag) == (0.0, "assumed")
    assert "holds at 99.4 to 101 rad/s: bag" in fit.law.viscous.source
    assert fit.errors["constant"].rms == pytest.approx(0.05, rel=0.05)  # the noise
    assert check_friction([fit]) == ([fit], [])


def falling_measurement():
    """Friction of a wrist below its Stribeck speed, at one temperature."""
    data = measurement(degc=(30.0, 32.0))
    w, random = data.motor_velocity, np.random.default_rng(1)
    torque = np.sign(w) * (0.3 + 0.5 * np.exp(-((w / 150.0) ** 2)))
    return replace(data, friction_torque=torque + random.normal(scale=0.03, size=len(w)))


def test_friction_that_falls_with_speed_has_a_stribeck_term():
    """The curve is that of a fit by scipy, and of the truth."""
    data = falling_measurement()
    fit = fit_friction(data)
    term = fit.stribeck
    w = np.linspace(20.0, 280.0, 30)

    def curve(w, fc, fs, ws):
        return fc + fs * np.exp(-((w / ws) ** 2))

    speed = np.abs(data.motor_velocity)
    fast = speed > 9.0
    along = (data.friction_torque * np.sign(data.motor_velocity))[fast]
    plain, _ = curve_fit(curve, speed[fast], along, p0=(0.5, 0.5, 100.0))
    found = fit.coulomb + fit.law.viscous.value * w
    found += term.torque.value * np.exp(-((w / term.velocity.value) ** 2))
    assert found == pytest.approx(curve(w, *plain), abs=0.02)
    assert found == pytest.approx(curve(w, 0.3, 0.5, 150.0), abs=0.02)
    assert fit.errors["constant"].rms == pytest.approx(0.03, rel=0.05)
    assert "falls with speed" in " ".join(fit.warnings)
    assert check_friction([fit]) == ([fit], [])


def test_the_stribeck_term_goes_into_the_model_file():
    before = load("kr16").joints[0].friction
    fit = fit_friction(falling_measurement(), "bag")
    assert fit.entry(before, "bag").stribeck == fit.stribeck
    # the whole friction is fitted: an earlier term would count twice
    again = fit.entry(before, "bag")
    assert fit_friction(measurement(), "bag").entry(again, "bag").stribeck is None


def test_a_law_that_cannot_be_fitted_leaves_the_other_rows():
    rising = measurement(law=lambda degc: 2e-3 + 1e-4 * (degc - 20.0))
    found = axis_study(rising, Span(high=45.0), Span(low=50.0), shuffles=0)
    assert {row.law for row in found.study.rows} == {"constant", "table"}
    assert "does not fall with temperature" in found.study.refused[0]
    assert found.gain is None
    plain = found.to_dict()["study"]["rows"][0]
    assert plain["viscous"]["viscous"]["value"] == pytest.approx(3.2e-3, rel=0.1)


def test_a_thermometer_that_is_off_moves_the_law_along_its_slope():
    """The law at the true temperature is off by its slope times the offset."""
    data = replace(measurement(noise=1e-4), thermometer=2.0)
    fit = fit_friction(data)
    law = viscous_law(fit.law)
    for degc in (25.0, 45.0, 65.0):
        slope = B / C * np.exp(-degc / C)
        assert float(law.std(degc)) == pytest.approx(2.0 * slope, rel=0.02)
    assert fit.coulomb_std < 1e-4


def test_a_torque_constant_that_is_off_moves_all_friction_by_its_share():
    data = measurement(noise=1e-4)
    changes = 0.03 * data.friction_torque[:, None]
    fit = fit_friction(replace(data, causes=("torque",), changes=changes))
    assert fit.coulomb_std == pytest.approx(0.03 * COULOMB, rel=0.01)
    assert fit.parts["coulomb"]["torque"] == pytest.approx(0.03 * COULOMB, rel=0.01)
    law = viscous_law(fit.law)
    for degc in (25.0, 65.0):
        assert float(law.std(degc)) == pytest.approx(0.03 * float(law.viscous(degc)), rel=0.02)
    assert fit.law.std == pytest.approx(float(law.std(fit.law.fitted_degc[0])), rel=0.02)


def test_a_log_without_velocities_says_which_column_is_wanted(tmp_path):
    joints = {
        "names": ["axle"],
        "position": {"columns": ["q"], "unit": "rad"},
        "effort": {"columns": ["i"], "unit": "ampere"},
    }
    log = write_csv(tmp_path / "log.csv", "t,q,i", ["0,0,1", "1,1,1"])
    (opened,) = open_logs([log], mapping(joints=joints, power=None))
    with pytest.raises(LogFormatError, match=r"no velocity of axle.*joints\.velocity"):
        friction_data_of_log([opened.whole()], ["axle"], 0)


def test_a_motion_that_determines_no_gravity_is_refused_in_words_of_the_joint():
    """Sine and cosine of a position that stands still are two columns that never change."""
    data = measurement(minutes=2)
    still = np.ones((len(data), 2))
    with pytest.raises(NotIdentifiableError, match="gravity term 1"):
        fit_friction(replace(data, nuisance=still))


@pytest.mark.filterwarnings("error")
def test_a_recording_without_samples_has_no_rows_of_friction():
    read = read_recording(ROOT / "bags/kr16_cold", load("kr16"), EffortMeaning.MOTOR_TORQUE)
    none = replace(read, torque=read.torque[:0], power=read.power[:0])
    assert len(friction_data([none], 0)) == 0
