"""Advice: savings against figures worked out by hand, and what is claimed at all."""

import json
import shutil
from base64 import b64decode

import numpy as np
import pytest

import histories
import robot_energy as re
from fleets import dataset
from places import ROOT
from robot_energy.foundation.errors import DatasetError, ParameterError
from robot_energy.model import load
from robot_energy.model.figure import PositiveFigure
from robot_energy.physics.friction import FrictionModel
from robot_energy.physics.rigid_body import Robot
from robot_energy.replay.bag_replay import replay
from robot_energy_cli.main import main
from robot_energy_fleet.advice.advise import _advice, _basis
from robot_energy_fleet.advice.claims import (
    Claim,
    of_all,
    regenerative,
    shared_bus,
    standby,
    waiting_pose,
    warm_up,
)
from robot_energy_fleet.advice.evidence import (
    DEGC_BINS,
    DEMAND_BINS,
    EvidenceSums,
    RecordedEvidence,
    RecordedRest,
    dataset_evidence,
)
from robot_energy_fleet.dataset import read_tables
from robot_energy_fleet.documents.advice import TITLES, advice_document
from robot_energy_history.store import HistoryStore
from robot_energy_plan.motion.ptp import MotionLimits, Program
from robot_energy_plan.motion.ptp_file import program_for, read_program
from robot_energy_plan.optimization.rest_states import RestState
from robot_energy_report.document import Document, Table, Text
from sound_recordings import write_states

MODEL = load("kr16")
LOSSY = load("irb4600")  # with losses of its drives, so that poses and speeds differ in cost
MOVES = ROOT / "src/examples/programs/kr16_pick_and_place.yaml"
POSES = [[0.5, -0.4, 0.5, 0, 1, 0], [0.5, 0.6, 0.3, 0, 1, 0]]
POSES += [[-0.7, -0.4, 0.5, 0, 1, 1.5], [-0.7, 0.6, 0.3, 0, 1, 1.5]]
SHARES = np.array([0.3, 0.3, 1.0, 1.0])  # of speed: two moves wait for nothing
SECOND = 1_000_000_000
SLEEP = RestState(name="sleep", power=0.25, wake_time=10.0, wake_power=2.0)
RATE = 100.0
LONG, SHORT = 70.0, 3.0


def rest(duration, watts, position=0.0, measured=None):
    found = RecordedRest(0, round(duration * SECOND), watts * duration, np.full(6, position))
    if measured is not None:
        found.compared_time = duration
        found.measured, found.predicted = measured * duration, watts * duration
    return found


def record_cycle(path, long=LONG):
    """A cycle with one long and three short rests."""
    limits = Robot.from_model(MODEL).limits
    loop = program_for(read_program(MOVES), limits).program
    program = Program(loop.via, loop.limits, [long, *[SHORT] * (len(loop.via) - 1)])
    time = np.arange(0.0, program.period, 1.0 / RATE)
    position = program.sample(time).joint_position
    write_states(path, MODEL.joint_names, RATE, position, np.empty((len(time), 0)))
    return path


def record_poses(path, long):
    """A cycle of the other robot, whose first two moves are slow."""
    limits = MotionLimits.of_robot(Robot.from_model(LOSSY), np.full(6, 5.0))
    dwell = [long, *[SHORT] * (len(POSES) - 1)]
    program = Program(POSES, limits, dwell, 0.6, SHARES, SHARES**2)
    time = np.arange(0.0, program.period, 1.0 / RATE)
    position = program.sample(time).joint_position
    write_states(path, LOSSY.joint_names, RATE, position, np.empty((len(time), 0)))
    return path


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return record_cycle(tmp_path_factory.mktemp("advice") / "bag")


@pytest.fixture(scope="module")
def poses(tmp_path_factory):
    return record_poses(tmp_path_factory.mktemp("advice") / "poses", LONG)


def test_standby_saves_what_the_sums_by_hand_say():
    # at rest on brakes this model needs its constant losses
    on_brakes = MODEL.cabinet.loss_grid.value + MODEL.cabinet.loss_dc.value
    held = on_brakes + 60.0
    claim = standby(
        RecordedEvidence(rests=[rest(300.0, held), rest(5.0, held)]), MODEL, [SLEEP], False
    )
    by_hand = held * 300.0 - on_brakes * (0.25 * 290.0 + 2.0 * 10.0)
    assert claim.energy == pytest.approx(by_hand)
    assert claim.sure == "predicted"
    assert "1 rests of a minute" in claim.found


def test_a_settled_rest_is_compared_whole_and_no_interval_is_kept_for_long(tmp_path):
    words = ["simulate", "--robot", "kr16", "--dwell", "8", "--rate", "100", "--duration", "60"]
    assert main([*words, "--seed", "2", "--out", str(tmp_path / "bag")]) == 0
    sums, waiting = EvidenceSums(MODEL), list[int]()

    def take(output):
        sums.take(output)
        waiting.append(sum(map(len, sums._compared)))

    replay(tmp_path / "bag", MODEL, on_output=take, on_compared=sums.compare)
    rests = sums.evidence(metered=True).rests
    assert len(rests) > 4
    for one in rests:  # less 2 s of settling, but for a reading of 0.1 s at either end
        assert one.duration - 2.1 < one.compared_time < one.duration - 1.9
        assert one.measured / one.compared_time == pytest.approx(400.0, rel=0.15)
        assert one.predicted / one.compared_time == pytest.approx(400.0, rel=0.01)
    assert max(waiting) < 200
    assert not any(one.compared_time for one in sums.evidence().rests)


def test_measured_watts_at_rest_replace_predicted_ones():
    on_brakes = MODEL.cabinet.loss_grid.value + MODEL.cabinet.loss_dc.value
    held = on_brakes + 60.0
    predicted = standby(RecordedEvidence(rests=[rest(300.0, held)]), MODEL, [SLEEP], False)
    claim = standby(
        RecordedEvidence(rests=[rest(300.0, held, 0.0, held + 40.0)]), MODEL, [SLEEP], False
    )
    by_hand = (held + 40.0) * 300.0 - (on_brakes + 40.0) * 92.5
    assert claim.energy == pytest.approx(by_hand)
    assert claim.sure == "measured"
    assert claim.half < predicted.half


def test_a_state_that_never_pays_is_no_advice():
    awake = RestState(name="awake", power=9.0, wake_time=1.0)
    assert standby(RecordedEvidence(rests=[rest(300.0, 200.0)]), MODEL, [awake], False) is None


def test_waiting_pose_takes_the_cheapest_place_that_a_meter_has_shown():
    rests = [rest(20.0, 300.0, 0.0, 340.0), rest(30.0, 300.0, 0.5, 290.0), rest(9.0, 1.0, 1.0)]
    claim = waiting_pose(RecordedEvidence(rests=rests), MODEL)
    assert claim.sure == "measured"
    assert claim.energy == pytest.approx(20.0 * 50.0, abs=20.0 * 30.0)
    assert claim.joint_position == pytest.approx(np.full(6, 0.5))
    # the third place has no meter, so nothing is claimed of it
    assert claim.places == pytest.approx(np.array([np.zeros(6), np.full(6, 0.5)]))
    assert " at 2 places" in claim.found
    assert "wait at the joint positions [0.50" in claim.change


def test_warm_friction_saves_the_difference_of_the_viscous_coefficients():
    squares = np.zeros((6, len(DEGC_BINS) - 1))
    time = np.zeros_like(squares)
    cold, warm = (int(np.searchsorted(DEGC_BINS, degc)) for degc in (30.0, 50.0))
    squares[:, cold], time[:, [cold, warm]] = 1e4, [50.0, 50.0]
    evidence = RecordedEvidence(squared_speed=squares, motion_time=time, measured_temperature=True)
    claim = warm_up(evidence, MODEL)
    friction = FrictionModel.from_model(MODEL)
    at = [friction.viscous(np.full(6, DEGC_BINS[row] + 0.5)) for row in (cold, warm)]
    assert claim.energy == pytest.approx(1e4 * (at[0] - at[1]).sum())
    assert claim.energy > 0.0
    # a fan may start: 5 % of what flows all the time, for as long as was recorded
    evidence.observed_time = 100.0
    longer = warm_up(evidence, MODEL)
    fan = 1.645 * 0.05 * MODEL.constant_power() * 100.0
    assert longer.half == pytest.approx(np.hypot(claim.half, fan), rel=1e-3)
    evidence.measured_temperature = False
    assert warm_up(evidence, MODEL) is None


def test_weaker_magnets_count_once_where_the_model_has_them():
    """The loss of a joint for each kelvin holds them where its torque constant falls."""
    loss = np.zeros((6, len(DEGC_BINS) - 1))
    time = np.zeros_like(loss)
    cold, warm = (int(np.searchsorted(DEGC_BINS, degc)) for degc in (30.0, 50.0))
    loss[:2, cold], time[:, [cold, warm]] = [30.0, 10.0], [50.0, 50.0]
    evidence = RecordedEvidence(
        squared_speed=0.0 * loss, motion_time=time, measured_temperature=True, warm_loss=loss
    )
    fall = PositiveFigure(value=0.001, tag="identified")
    joints = [MODEL.joints[0].model_copy(update={"torque_constant_fall": fall}), *MODEL.joints[1:]]
    assert warm_up(evidence, MODEL).energy == pytest.approx(-20.0 * 1.5 * (30.0 + 10.0))
    found = warm_up(evidence, MODEL.changed(joints=joints))
    assert found.energy == pytest.approx(-20.0 * (30.0 + 1.5 * 10.0))


def test_braked_energy_is_that_of_the_replay():
    path = ROOT / "bags/kr16_cold"
    report = re.advise(path, MODEL, look_at_speeds=False).report
    found = next(one for one in (*report.advice, *report.unproven) if one.name == "regenerative")
    brake = re.replay(path, MODEL).energy.brake
    assert found.energy == pytest.approx(0.9 * brake, rel=1e-3)
    assert report.basis.recorded_energy == pytest.approx(re.replay(path, MODEL).energy.grid_import)


def test_a_recording_given_twice_counts_once_and_is_named(tmp_path):
    cold, warm = ROOT / "bags/kr16_cold", ROOT / "bags/kr16_warm"
    copy = shutil.copytree(cold, tmp_path / "copy")
    once = re.advise([cold, warm], MODEL, look_at_speeds=False).report
    found = re.advise([cold, cold, copy, warm], MODEL, look_at_speeds=False).report
    assert found.basis == once.basis
    assert found.source == (str(cold), str(warm))
    assert f"{cold} was given twice: it counts once" in found.notes
    assert f"{copy} is the same recording as {cold}: they count once" in found.notes
    (overlap,) = once.notes
    assert overlap.startswith(f"{cold}, {warm} overlap in time, by 36.0 s in all")


def test_a_warm_start_is_tried_at_the_warm_temperature_on_the_coldest_recording():
    bags = [str(ROOT / "bags" / name) for name in ("kr16_warm", "kr16_cold")]
    report = re.advise(bags, "kr16", look_at_speeds=False).report
    (warm,) = [one for one in (*report.advice, *report.unproven) if one.name == "warm_up"]
    degc = warm.change.split()[2]
    assert int(degc) > 50
    assert warm.command == f"robot-energy replay {bags[1]} --model kr16 --compare {degc}"


def test_short_stops_belong_to_the_work_and_the_basis_says_so(capsys):
    """`replay` shows 15 % of this bag at rest, in stops shorter than a second."""
    bag = str(ROOT / "bags/kr16_cold")
    assert main(["advise", bag, "--model", "kr16", "--no-speeds"]) == 0
    said = capsys.readouterr().out
    assert "in motion  " not in said
    assert "at work is all but rests of 1 s and more; " in said


def test_no_supply_is_advised_where_there_is_one():
    share = {"value": 0.8, "tag": "assumed"}
    cabinet = MODEL.cabinet.model_copy(update={"regeneration_efficiency": share})
    evidence = RecordedEvidence(brake_energy=1e3)
    assert regenerative(evidence, MODEL) is not None
    assert regenerative(evidence, MODEL.changed(cabinet=cabinet)) is None


def demand(*parts):
    """Evidence of so many seconds at each demand on the bus [W]."""
    value, time = np.array(parts).T
    found = RecordedEvidence(observed_time=time.sum(), brake_columns=np.array([30.0]))
    found.brake_energy = float(np.maximum(-value, 0.0) @ time)
    found.demand = np.stack(
        [np.histogram(value, DEMAND_BINS, weights=each)[0] for each in (time, value * time)]
    )
    return found


def test_two_robots_on_one_bus_by_hand():
    # a quarter of the time both brake 400 W, half of it one brakes while the other draws 600 W:
    # 100 J/s go into each resistor in the mean of four cases instead of 200
    claim = shared_bus(demand((600.0, 50.0), (-400.0, 50.0)), MODEL)
    assert claim.energy == pytest.approx(100.0 * 100.0)
    assert claim.half == pytest.approx(1.645 * np.hypot(0.5 * 30.0, 0.25 * 1e4), rel=1e-3)
    # 100 W less than the other brakes: of two in three cases 300 W are left, one keeps 100 W
    little = shared_bus(demand((100.0, 50.0), (-400.0, 50.0)), MODEL)
    assert little.energy == pytest.approx(0.5 * 100.0 * 0.5 * 100.0)
    assert shared_bus(RecordedEvidence(), MODEL) is None
    kept = demand((600.0, 50.0), (-400.0, 50.0))
    # a capacitor keeps the rest: exp(-E/m) = 1/4, and with half of m and 1.5 E it is 1/64 of that
    kept.brake_energy /= 4.0
    assert shared_bus(kept, MODEL).energy == pytest.approx(2e4 * (0.25 - 0.5 / 64.0))


def test_a_recording_with_rests_gives_a_ranked_list(poses):
    result = re.advise(poses, LOSSY, price=0.5, co2=0.4, hours_per_day=10.0, days_per_year=200.0)
    report = result.report
    everything = (*report.advice, *report.unproven)
    names = {one.name for one in everything}
    assert names == {"standby", "speeds", "waiting_pose", "regenerative", "shared_bus"}
    energies = [one.energy for one in report.advice]
    assert energies == sorted(energies, reverse=True)
    assert all(one.energy > one.half for one in report.advice)
    assert all(one.energy <= one.half for one in report.unproven)
    one = everything[0]
    year = one.energy / report.basis.recorded_time * 3600.0 * 10.0 * 200.0
    assert one.energy_per_year == pytest.approx(year)
    assert one.cost_per_year == pytest.approx(year / 3.6e6 * 0.5)
    assert one.co2_per_year == pytest.approx(year / 3.6e6 * 0.4)
    saved = {one.name: one for one in report.advice}
    for name in report.counted:
        assert not set(saved[name].overlaps) & set(report.counted)
    assert report.energy_per_year == pytest.approx(
        sum(saved[name].energy_per_year for name in report.counted)
    )
    assert report.half_per_year == pytest.approx(
        sum(saved[name].half_per_year for name in report.counted)
    )
    page = Document()
    advice_document(report, page)
    lines = [part.text for _, part in page.parts if isinstance(part, Text)]
    assert lines[0].startswith("Seen: ")
    assert "a year" not in lines[0]
    tables = [part.title for _, part in page.parts if isinstance(part, Table)]
    assert tables[1:] == [
        *TITLES[: 1 + bool(report.unproven)],
        "In a year of 10 h a day on 200 days",
    ]
    assert sum(line.startswith("To try: ") for line in lines) == len(everything)
    labels = {one.name: one.label for one in everything}
    shared = [[labels[name] for name in one.overlaps if name in labels] for one in everything]
    assert any(shared)
    for others in filter(None, shared):
        assert any(line.startswith(f"Overlaps with: {', '.join(others)}. They") for line in lines)


def test_rests_are_those_of_the_program(bag):
    sentence = re.advise(bag, MODEL, look_at_speeds=False).report
    found = next(one for one in (*sentence.advice, *sentence.unproven) if one.name == "standby")
    assert "in 1 rests of a minute or more" in found.found
    assert sentence.basis.duty < 0.5


def test_what_overlaps_is_counted_once():
    basis = _basis(
        RecordedEvidence(observed_time=3600.0, grid_energy=1e6),
        {"hours_per_day": 1.0, "days_per_year": 1.0},
    )
    claim = Claim("speeds", 100.0, np.array([1.0]), "predicted", "", "")
    assert _advice(claim, basis).overlaps == ("warm_up", "regenerative", "shared_bus")
    assert _advice(claim, basis).energy_per_year == pytest.approx(100.0)


def test_the_basis_of_a_year_is_that_of_the_recordings():
    days = RecordedEvidence(observed_time=8 * 36e2 * 10, start_ns=0, end_ns=10 * 86_400 * SECOND)
    basis = _basis(days, {})
    assert basis.hours_per_day == pytest.approx(8.0)
    assert basis.days_per_year == 365.0
    short = _basis(RecordedEvidence(observed_time=60.0), {})
    assert (short.hours_per_day, short.days_per_year) == (None, None)
    assert short.sentence.count("not known") == 2
    claim = Claim("speeds", 100.0, np.array([1.0]), "predicted", "", "")
    assert _advice(claim, short).energy_per_hour == pytest.approx(6000.0)
    assert _advice(claim, short).energy_per_year is None


def test_a_dataset_gives_standby_and_no_places(tmp_path):
    folder = dataset(tmp_path / "fleet", 1, faults=False, pause=100.0)
    with pytest.raises(DatasetError, match="holds no bag of model"):
        dataset_evidence(folder, load("ur5e"))
    tables = read_tables(folder)
    found, bags = dataset_evidence(folder, MODEL)
    assert bags == []  # this fleet was generated without any
    assert found.observed_time == pytest.approx(tables.runs["observed_time"].sum())
    standby_time = sum(one.duration for one in found.rests)
    assert 0 < standby_time <= tables.hours["standby_time"].sum() * (1 + 1e-9)
    energy = sum(one.energy for one in found.rests)
    assert 0 < energy <= tables.hours["standby_energy"].sum() * (1 + 1e-9)
    report = re.advise(folder, MODEL).report
    assert any("waiting pose" in sentence for sentence in report.without)
    dearest = tables.runs.sort("grid_energy")["bag"][-1]
    assert any(dearest in note for note in report.notes)


def test_a_history_gives_standby_of_live_robots(tmp_path):
    """Nights of ten hours in standby at 300 W, for five days."""
    store = HistoryStore(tmp_path)
    store.open()
    robot = histories.Robot(model=MODEL.model_id)
    for _ in range(5):
        for hour in range(24):
            for _ in range(4):
                robot.advance(histories.HOUR // 4, 300 if hour < 10 else 900, standby=hour < 10)
                store.add("cell", [robot.read(robot.now)])
        assert store.write(robot.now), store.trouble
    store.close()
    found, bags = dataset_evidence(tmp_path, MODEL)
    assert bags == []
    assert [one.duration for one in found.rests] == pytest.approx([36_000.0] * 5)
    assert sum(one.energy for one in found.rests) == pytest.approx(5 * 10 * 3600 * 300)
    assert found.observed_time == pytest.approx(5 * 86_400)
    report = re.advise(tmp_path, MODEL).report
    assert any("a history" in note for note in report.notes)


def test_bags_of_a_dataset_say_what_its_sums_do_not(tmp_path):
    for number in range(3):
        record_poses(tmp_path / "hall" / f"bag{number}", long=10.0 + number)
    out = tmp_path / "fleet"
    re.fleet_run(tmp_path / "hall", out, LOSSY, workers=0, max_gap=0.5)
    evidence, bags = dataset_evidence(out, LOSSY)
    assert len(bags) == evidence.recordings >= 3
    assert bags[0].options == {"max_gap": 0.5}
    report = re.advise(out, LOSSY).report
    assert any("3 of its 3 bags are analysed" in note for note in report.notes)
    several = re.advise([bag.address for bag in bags], LOSSY, max_gap=0.5).report
    each = [energies(re.advise(bag.address, LOSSY, max_gap=0.5).report) for bag in bags]
    for name in ("speeds", "waiting_pose"):
        assert energies(report)[name] == pytest.approx(sum(one[name] for one in each))
    assert energies(several)["speeds"] == pytest.approx(energies(report)["speeds"])
    for number in range(2):
        shutil.rmtree(tmp_path / "hall" / f"bag{number}")
    assert dataset_evidence(out, LOSSY)[1] == []


def test_bags_of_a_dataset_are_opened_without_files_of_which_it_has_a_hash(tmp_path):
    for number in range(3):
        record_poses(tmp_path / "hall" / f"bag{number}", long=10.0 + number)
    jobs, inputs = tmp_path / "jobs.yaml", tmp_path / "inputs.yaml"
    jobs.write_text("jobs:\n  - {name: pick, begin: 1.0, end: 2.0}\n")
    inputs.write_text("/**:\n  ros__parameters:\n    max_gap: 0.5\n")
    with_jobs, with_inputs = tmp_path / "jobs", tmp_path / "inputs"
    re.fleet_run(tmp_path / "hall", with_jobs, LOSSY, workers=0, jobs=jobs, max_gap=0.5)
    _, bags = dataset_evidence(with_jobs, LOSSY)
    assert [bag.options for bag in bags] == [{"max_gap": 0.5}] * 3
    assert re.advise(with_jobs, LOSSY, look_at_speeds=False).report.problems == ()
    re.fleet_run(tmp_path / "hall", with_inputs, LOSSY, workers=0, inputs=inputs, max_gap=0.5)
    found, bags = dataset_evidence(with_inputs, LOSSY)
    assert bags == []
    assert any("not analysed: 3 bags replayed with a file of inputs" in one for one in found.notes)
    found, bags = dataset_evidence(with_inputs, LOSSY, {"inputs": inputs, "max_gap": None})
    assert [bag.options for bag in bags] == [{"max_gap": 0.5, "inputs": inputs}] * 3
    assert not any("not analysed" in one for one in found.notes)


def test_each_robot_of_a_bag_is_looked_at_with_its_own_options(tmp_path):
    record_poses(tmp_path / "bag", long=10.0)
    out = tmp_path / "fleet"
    for name, gap in (("left", 0.5), ("middle", 0.6), ("right", 0.7)):
        re.fleet_run(tmp_path / "bag", out, LOSSY, name=name, workers=0, max_gap=gap)
    found, bags = dataset_evidence(out, LOSSY)
    assert [bag.options for bag in bags] == [{"max_gap": 0.5}, {"max_gap": 0.6}, {"max_gap": 0.7}]
    assert not any("overlap" in note for note in found.notes)


def energies(report):
    return {one.name: one.energy for one in (*report.advice, *report.unproven)}


def test_some_bags_speak_for_all_of_a_dataset():
    claims = [
        Claim("x", energy, np.array([3.0, 4.0]), "predicted", "", "") for energy in (8.0, 4.0)
    ]
    both = of_all([*claims, None], [10.0, 10.0, 10.0], 300.0, 30)
    assert both.energy == pytest.approx(120.0)
    # model: 10 (5 + 5); spread: residuals 4, 0, -4, so 10 sqrt(0.9 * 1.5 * 32), t of two degrees
    spread = 10.0 * np.sqrt(0.9 * 1.5 * 32.0) * 2.92
    assert both.half == pytest.approx(np.hypot(1.6448536 * 100.0, spread), rel=1e-4)
    assert "2 of 3 analysed bags, of 30 in all" in both.found
    assert of_all(claims, [10.0, 10.0], 300.0, 30) is None  # too few to know their spread
    assert of_all([None] * 3, [10.0] * 3, 300.0, 30) is None


def test_the_command_writes_json(bag, tmp_path, capsys):
    path, page = tmp_path / "advice.json", tmp_path / "advice.html"
    words = ["advise", str(bag), "--model", "kr16", "--no-speeds", "--price", "0.3"]
    assert main([*words, "--json", str(path), "--report", str(page)]) == 0
    found = json.loads(path.read_text())
    assert found["result"] == "advice"
    assert "standby" in capsys.readouterr().out
    assert "standby instead of drives that hold" in page.read_text()


def test_the_page_names_what_is_not_proven(tmp_path):
    page = tmp_path / "advice.html"
    bag = str(ROOT / "bags/kr16_all_topics")
    assert main(["advise", bag, "--model", "kr16", "--no-speeds", "--report", str(page)]) == 0
    said = page.read_text()
    assert said.index("but not proven by them") < said.rindex("a warmer start")


def test_the_page_has_names_of_the_table_in_its_figure_and_what_was_not_found_apart(tmp_path):
    path = tmp_path / "a.html"
    bags = [str(ROOT / "bags" / name) for name in ("kr16_cold", "kr16_warm")]
    assert main(["advise", *bags, "--model", "kr16", "--no-speeds", "--report", str(path)]) == 0
    page = path.read_text()
    pictures = [part.partition('"')[0] for part in page.split("image/svg+xml;base64,")[1:]]
    assert any(b">a regenerative supply<" in b64decode(one) for one in pictures)
    assert page.index(">Not found<") < page.index("standby: no rest of a minute")
    assert "<code>robot-energy replay" in page


def test_what_saves_next_to_nothing_is_not_listed():
    report = re.advise(ROOT / "bags/drawn_train_warm", MODEL).report
    names = {one.name for one in (*report.advice, *report.unproven)}
    assert names == {"regenerative", "shared_bus"}
    assert sum("less than 0.05 % of the energy" in sentence for sentence in report.without) == 2


def test_figures_that_make_no_sense_are_refused(bag):
    with pytest.raises(ParameterError, match="'price' of advise is -1"):
        re.advise(bag, MODEL, price=-1.0)
    with pytest.raises(ParameterError, match="no recording"):
        re.advise([], MODEL)
