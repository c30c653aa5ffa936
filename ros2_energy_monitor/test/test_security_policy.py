# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The SROS 2 policy: exactly what running nodes use, in names that the nodes really have."""

import subprocess
import sys
from xml.etree import ElementTree

import pytest
from ros2_energy_msgs.msg import EnergyRegisters

from ros2_energy_monitor.nodes.energy_dashboard import EnergyDashboard
from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor
from ros2_energy_monitor.nodes.virtual_robot import VirtualRobot
from ros2_energy_monitor.security_policy import NODES, NodeRights, is_seen, main, rights_of

RULES = (("topics", "publish"), ("topics", "subscribe"), ("services", "reply"),
         ("services", "request"))  # fmt: skip


def read(path):
    """Rights by node, after a look at the form that the schema of SROS 2 asks for."""
    policy = ElementTree.parse(path).getroot()
    assert (policy.tag, policy.attrib, [one.tag for one in policy]) == (
        "policy", {"version": "0.2.0"}, ["enclaves"],
    )  # fmt: skip
    found = {}
    for enclave in policy.findall("enclaves/enclave"):
        (profile,) = enclave.findall("profiles/profile")
        full = f"{profile.get('ns').rstrip('/')}/{profile.get('node')}"
        assert enclave.get("path") == full
        rules = {}
        for listed in profile:
            ((right, word),) = listed.attrib.items()
            assert word == "ALLOW"
            assert (listed.tag, right) in RULES
            assert {one.tag for one in listed} == {listed.tag[:-1]}
            rules[right] = frozenset(one.text for one in listed)
        found[full] = NodeRights(full, **rules)
    return found


@pytest.fixture(scope="module")
def policy(tmp_path_factory):
    path = tmp_path_factory.mktemp("policy") / "policy.xml"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
        assert main(["--out", str(path), "--ros-args"]) == 0
    return read(path)


def test_the_policy_starts_without_the_web_server_of_the_dashboard():
    blocked = (
        "import sys; sys.modules['uvicorn'] = None; import ros2_energy_monitor.security_policy"
    )
    subprocess.run([sys.executable, "-c", blocked], check=True)


def test_every_node_that_runs_for_long_has_its_enclave(policy):
    assert list(policy) == [f"/{name}" for name in NODES]


def test_the_policy_is_what_running_nodes_use(bench, policy):
    robot = bench.add(VirtualRobot, rate=50.0)
    monitor = bench.add(EnergyMonitor, model="kr16", state_folder="")
    page = bench.add(EnergyDashboard, port=0)
    registers = bench.latest(EnergyRegisters, "energy/registers")
    bench.spin_until(lambda: registers() and registers().observed_time > 0.0, "energy")
    bench.spin_until(lambda: any(True for _ in page.clients), "the list of intervals")
    for node in (robot, monitor, page):
        bench.spin_until(lambda node=node: is_seen(node), node.get_name())
        assert rights_of(node) == policy[node.get_fully_qualified_name()]


def test_namespaces_parameters_and_buttons_are_part_of_it(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
    path, token, file = (tmp_path / name for name in ("policy.xml", "token", "page.yaml"))
    token.write_text("a-token-of-enough-characters-1234567890")
    token.chmod(0o600)
    file.write_text(f"/**:\n  ros__parameters: {{allow_control: true, token_file: '{token}'}}\n")
    words = ["--ros-args", "-r", "__ns:=/cell", "--params-file", str(file)]
    assert main(["--out", str(path), "--nodes", "energy_dashboard", *words]) == 0
    found = read(path)["/cell/energy_dashboard"]
    assert {"/cell/energy/power", "/cell/energy/registers"} <= found.subscribe
    actions = ("list_intervals", "open_interval", "close_interval", "reset_registers")
    assert found.request == {f"/cell/energy_monitor/{name}" for name in actions}


def test_what_cannot_be_made_is_one_sentence(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
    path = tmp_path / "policy.xml"
    path.write_text("mine")
    assert main(["--out", str(path), "--nodes", "console", "--ros-args"]) == 2
    assert "policy.xml" in capsys.readouterr().out
    assert path.read_text() == "mine"
