"""Metrics as Prometheus reads them, with its own parser, its own tools and its own server."""

import json
import math
import re
import shutil
import subprocess
import urllib.parse
import urllib.request

import pytest
import yaml
from prometheus_client.openmetrics.parser import text_string_to_metric_families

from page_client import PATIENCE, wait_until
from page_messages import power_states, recorded, registers
from places import GRAFANA
from robot_energy_cli import main
from robot_energy_report.page.access import page_access
from robot_energy_report.page.hub import PageHub
from robot_energy_report.page.metrics import METRICS, metrics_text
from robot_energy_report.page.settings import PageSettings
from robot_energy_report.page.web_server import PageServer

PROMETHEUS, PROMTOOL = shutil.which("prometheus"), shutil.which("promtool")


def families(hub, now=0.0):
    text = metrics_text(hub, now).decode()
    assert text.endswith("# EOF\n")
    return {family.name: family for family in text_string_to_metric_families(text)}


def samples(family, ending=""):
    return {
        tuple(sorted(one.labels.items())): one.value
        for one in family.samples
        if one.name == family.name + ending
    }


@pytest.fixture
def hub():
    hub = PageHub("", PageSettings())
    hub.robot("r").take_power(power_states([1.0], [100.0]), 0.0)
    hub.robot("r").take_registers(registers(7200.0, start=2.0))
    return hub


def test_counters_are_the_registers_since_they_began():
    page, result = recorded()
    found = families(page.hub)
    energy = samples(found["robot_energy_joules"], "_total")
    cabinet = result.account.registers.cabinet
    assert energy[("part", "predicted_import"), ("robot", "kr16_cold")] == cabinet("grid_import")
    assert energy[("part", "brake_resistor"), ("robot", "kr16_cold")] == cabinet("brake")
    created = samples(found["robot_energy_joules"], "_created")
    assert set(created.values()) == {result.account.start_ns * 1e-9}
    friction = samples(found["robot_joint_friction_energy_joules"], "_total")
    assert sum(friction.values()) == pytest.approx(
        result.account.registers.joints("friction").sum()
    )


def test_a_reset_begins_a_new_counter(hub):
    before = samples(families(hub)["robot_energy_joules"], "_created")
    hub.robot("r").take_registers(registers(0.0, stamp=19.0, start=19.0))
    empty = samples(families(hub)["robot_energy_joules"], "_total")
    assert empty[("part", "predicted_import"), ("robot", "r")] == 0.0
    hub.robot("r").take_registers(registers(5.0, stamp=20.0, start=19.0))
    after = families(hub)["robot_energy_joules"]
    assert set(samples(after, "_created").values()) != set(before.values())
    assert samples(after, "_total")[("part", "predicted_import"), ("robot", "r")] == 5.0


def test_unknown_is_nan_in_gauges_and_absent_in_counters(hub):
    hub.robot("r").take_registers(registers(math.nan))
    found = families(hub)
    energy = samples(found["robot_energy_joules"], "_total")
    assert (("part", "predicted_import"), ("robot", "r")) not in energy
    assert math.isnan(samples(found["robot_power_watts"])[("robot", "r"), ("source", "measured")])
    assert not any(math.isnan(value) for value in energy.values())


@pytest.mark.parametrize(("measured", "predicted"), [(500.0, math.nan), (math.nan, math.nan)])
def test_energies_at_the_meter_have_no_sample_until_both_are_known(hub, measured, predicted):
    """The alert compares their changes over an hour, which one NaN would make NaN."""
    energies = {"measured_energy": measured, "predicted_energy_at_meter": predicted}
    hub.robot("r").take_registers(registers(5.0, stamp=19.0, **energies))
    assert not families(hub)["robot_energy_at_meter_joules"].samples
    known = {"measured_energy": 900.0, "predicted_energy_at_meter": 910.0}
    hub.robot("r").take_registers(registers(9.0, stamp=20.0, **known))
    found = samples(families(hub)["robot_energy_at_meter_joules"])
    assert {labels[1][1]: value for labels, value in found.items()} == {
        "measured": 900.0, "predicted": 910.0,
    }  # fmt: skip


def test_no_message_makes_a_page_that_no_scrape_takes(hub):
    """Joints named twice would repeat series; a counter below 0 is none."""
    hub.robot("r").take_power(power_states([2.0], [1.0], names=("a", "a", "b")), 0.0)
    hub.robot("r").take_registers(registers(-5.0))
    found = families(hub)
    power = found["robot_joint_friction_power_watts"]
    assert [one.labels["joint"] for one in power.samples] == ["a", "b"]
    energy = samples(found["robot_energy_joules"], "_total")
    assert (("part", "predicted_import"), ("robot", "r")) not in energy
    assert all(value >= 0.0 for value in energy.values())


def test_stale_powers_are_nan_and_up_is_zero(hub):
    found = families(hub, 60.0)
    assert all(math.isnan(value) for value in samples(found["robot_power_watts"]).values())
    assert samples(found["robot_energy_up"]) == {(("robot", "r"),): 0.0}
    assert samples(found["robot_energy_joules"], "_total")


def test_labels_are_escaped_and_bounded(hub):
    evil = 'a"\n\\{}# EOF'
    names = tuple(f"{evil}{number}" for number in range(90))
    hub.robot("r").take_power(power_states([2.0], [1.0], names=names), 0.0)
    found = samples(families(hub)["robot_joint_temperature_celsius"])
    assert len(found) == 90
    huge = tuple(f"j{number}" for number in range(5000))
    hub.robot("r").take_power(power_states([3.0], [1.0], names=huge), 0.0)
    assert len(samples(families(hub)["robot_joint_temperature_celsius"])) == 90


def queries():
    board = json.loads((GRAFANA / "grafana.json").read_text())
    rules = yaml.safe_load((GRAFANA / "alert_rules.yaml").read_text())["groups"][0]["rules"]
    targets = [one for panel in board["panels"] for one in panel["targets"]]
    return [rule["expr"] for rule in rules] + [target["expr"] for target in targets]


def test_every_metric_of_a_query_is_served():
    page, _ = recorded()
    served = {one.name for family in families(page.hub).values() for one in family.samples}
    served.add("robot_joint_drive_loss_energy_joules_total")  # this model has none
    own = [one for one in METRICS.values() if "load" not in one.labels]
    assert {f"{one.name}_total" if one.counter else one.name for one in own} <= served
    for query in queries():
        names = set(re.findall(r"\brobot_\w+(?=\{)", query))
        assert names, query
        assert names <= served, query


@pytest.fixture
def files(tmp_path, capsys):
    def write(*words):
        folder = tmp_path / "monitoring"
        assert main(["monitoring", "--out", str(folder), *words]) == 0
        return folder

    return write


def test_the_files_are_written_again_but_never_over_others(files, tmp_path):
    folder = files()
    assert json.loads((folder / "grafana.json").read_text())["panels"]
    files()
    (folder / "alert_rules.yaml").write_text("mine")
    assert main(["monitoring", "--out", str(folder)]) == 2
    assert (folder / "alert_rules.yaml").read_text() == "mine"


@pytest.mark.skipif(PROMTOOL is None, reason="no promtool: apt-get install prometheus")
def test_the_files_are_valid_for_prometheus(files):
    folder = files()
    for words in (["check", "rules", "alert_rules.yaml"], ["check", "config", "prometheus.yaml"]):
        found = subprocess.run([PROMTOOL, *words], cwd=folder, capture_output=True, check=False)
        assert found.returncode == 0, found.stdout + found.stderr


@pytest.mark.skipif(PROMETHEUS is None, reason="no prometheus: apt-get install prometheus")
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_a_real_prometheus_reads_counters_and_a_reset(files, hub, tmp_path):
    hub.tick(0.0)
    server = PageServer(hub, page_access())
    folder = files("--target", server.url.removeprefix("http://").rstrip("/"))
    config = folder / "prometheus.yaml"
    config.write_text(config.read_text().replace("5s", "1s"))
    log = (tmp_path / "log").open("wb")
    process = subprocess.Popen(
        [PROMETHEUS, f"--config.file={config}", "--web.listen-address=127.0.0.1:0",
         f"--storage.tsdb.path={tmp_path / 'data'}"],
        stdout=log, stderr=log,
    )  # fmt: skip

    def listens_on():
        assert process.poll() is None
        return re.search(r'"Listening on".* address=(\S+)\n', (tmp_path / "log").read_text())

    def ask(path, **query):
        address = f"http://{place}/api/v1/{path}?{urllib.parse.urlencode(query)}"
        try:
            with urllib.request.urlopen(address, timeout=PATIENCE) as answer:
                return json.load(answer)["data"]
        except OSError:
            return {}

    def values(query):
        return [float(one["value"][1]) for one in ask("query", query=query).get("result", [])]

    counter = 'robot_energy_joules_total{part="predicted_import"}'
    try:
        place = wait_until(listens_on, "the port of Prometheus")[1]
        wait_until(lambda: values(counter) == [7200.0], "the counter")
        with hub.lock:
            hub.robot("r").take_registers(registers(9000.0, stamp=30.0, start=2.0))
        wait_until(lambda: values(counter) == [9000.0], "the counter to grow")
        with hub.lock:
            hub.robot("r").take_registers(registers(5.0, stamp=60.0, start=50.0))
        wait_until(lambda: values(counter) == [5.0], "the counter after a reset")
        assert values(f"resets({counter}[10m])") == [1.0]
        wait_until(lambda: health(ask) == ["up"], "a target that is up")
        wait_until(
            lambda: {rule["health"] for rule in rules_now(ask)} not in (set(), {"unknown"}),
            "the rules",
        )
        assert {rule["health"] for rule in rules_now(ask)} <= {"ok", "unknown"}, rules_now(ask)
        wait_until(lambda: stale_state(ask) in ("pending", "firing"), "the alert on stale figures")
    finally:
        process.terminate()
        process.wait(PATIENCE)
        log.close()
        server.close()


def health(ask):
    return [one["health"] for one in ask("targets").get("activeTargets", [])]


def rules_now(ask):
    return [rule for group in ask("rules").get("groups", []) for rule in group["rules"]]


def stale_state(ask):
    return next((r["state"] for r in rules_now(ask) if r["name"] == "RobotEnergyStale"), "")
