"""Layouts of viewers: well formed, complete, and every path leads to a number of a bag."""

import ast
import json
import re
from xml.etree import ElementTree

import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from places import ROOT
from robot_energy.foundation.errors import MessageTypeError
from robot_energy.messages.fields import JOINT_STATES_TOPIC
from robot_energy.model import load
from robot_energy_cli.main import main
from robot_energy_report import layouts
from robot_energy_report.layouts import LAYOUTS, pages, write_layouts

BAG = ROOT / "bags/kr16_all_topics"
JOINTS = load("kr16").joint_names


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("layouts")
    write_layouts(made, JOINTS)
    return made


@pytest.fixture(scope="module")
def messages():
    """The last message of every topic of the bag, read by rosbags with the bag's definitions."""
    found = {}
    with AnyReader([BAG], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        for connection, _, raw in reader.messages():
            found[connection.topic] = reader.deserialize(raw, connection.msgtype)
    return found


def foxglove_paths(document):
    """Every message path of a Foxglove or Lichtblick layout, wherever it stands."""
    if isinstance(document, dict):
        if "timestampMethod" in document:
            yield document["value"]
        if "topicToRender" in document:
            yield document["topicToRender"]
        for value in document.values():
            yield from foxglove_paths(value)
    elif isinstance(document, list):
        for value in document:
            yield from foxglove_paths(value)


def resolve_foxglove(path, messages):
    topic = max((name for name in messages if path.startswith(name)), key=len)
    here = messages[topic]
    rest = path.removeprefix(topic)
    for name, index, filtered in re.findall(
        r'\.(\w+)(?:\[(\d+)\])?(?:\[:\]\{name=="([^"]+)"\})?', rest
    ):
        here = getattr(here, name)
        if index:
            here = here[int(index)]
        if filtered:
            (here,) = [one for one in here if one.name == filtered]
    return here


def resolve_slashes(path, messages):
    topic = max((name for name in messages if path.startswith(name + "/")), key=len)
    here = messages[topic]
    for name, index in re.findall(r"/(\w+)(?:\[(\d+)\])?", path.removeprefix(topic)):
        here = getattr(here, name)
        here = here[int(index)] if index else here
    return here


def paths_of(folder):
    """Every path of every layout, with what resolves it."""
    for name in ("foxglove.json", "lichtblick.json"):
        document = json.loads((folder / name).read_text())
        yield from ((name, path, resolve_foxglove) for path in foxglove_paths(document))
    root = ElementTree.parse(folder / "plotjuggler.xml").getroot()
    for curve in root.iter("curve"):
        yield "plotjuggler.xml", curve.get("name"), resolve_slashes
    groups = json.loads((folder / "rqt.perspective").read_text())["groups"]["pluginmanager"]
    for plugin in groups["groups"].values():
        topics = plugin["groups"]["plugin"]["keys"].get("topics")
        for path in ast.literal_eval(topics["repr"]) if topics else ():
            yield "rqt.perspective", path, resolve_slashes


def test_every_path_of_every_layout_leads_to_a_number_of_the_bag(folder, messages):
    seen = set()
    for file, path, resolve in paths_of(folder):
        seen.add(file)
        if path == "/diagnostics":
            assert messages[path].status
            continue
        value = resolve(path, messages)
        assert float(value) is not None, (file, path)
    assert seen == set(LAYOUTS)


def test_the_bag_has_all_topics_and_was_simulated(messages):
    named = {topic for topic, _, _, _ in layouts.TOPICS}
    assert set(messages) == named | {JOINT_STATES_TOPIC, layouts.DIAGNOSTICS}
    assert messages["/energy/payload"].inertia.m == 5.0
    assert "simulated" in (BAG / "metadata.yaml").read_text()


def test_every_number_of_every_message_is_somewhere(folder):
    """Against the definitions, read by an expression of their own."""
    text = (folder / "foxglove.json").read_text()
    for topic, kind, totals, by_joint in layouts.TOPICS:
        definition = (ROOT / f"ros2_energy_msgs/msg/{kind}.msg").read_text()
        for name in re.findall(r"^float64 (\w+)$", definition, re.M) if totals else ():
            assert f'"{topic}.{name}"' in text
        for name in re.findall(r"^float64\[\] (\w+)$", definition, re.M) if by_joint else ():
            assert f'"{topic}.{name}[5]"' in text


def test_a_message_that_is_gone_stops_the_making(monkeypatch):
    monkeypatch.setattr(layouts, "TOPICS", (("/energy/power", "Power", "Power", ""),))
    with pytest.raises(MessageTypeError, match="no message Power; expected one of"):
        pages(JOINTS)


def test_lichtblick_names_every_panel_once(folder):
    document = json.loads((folder / "lichtblick.json").read_text())

    def leaves(node):
        if isinstance(node, str):
            return [node]
        return leaves(node["first"]) + leaves(node["second"])

    root = document["layout"]
    used = [root]
    for tab in document["configById"][root]["tabs"]:
        used += leaves(tab["layout"])
    assert sorted(used) == sorted(document["configById"])


def test_foxglove_is_tabs_of_splits_of_panels(folder):
    document = json.loads((folder / "foxglove.json").read_text())
    assert document["version"] == 1
    tabs = document["content"]["tabs"]
    assert tabs[0]["title"] == "Energy"
    assert tabs[-1]["content"]["panelType"] == "DiagnosticsSummary"


def test_the_command_writes_replaces_its_own_and_no_other_file(tmp_path, capsys):
    folder = tmp_path / "new"
    assert main(["layouts", "--out", str(folder), "--model", "ur5e"]) == 0
    assert main(["layouts", "--out", str(folder), "--model", "ur5e"]) == 0
    assert capsys.readouterr().out.count("foxglove.json") == 2
    assert "shoulder_pan_joint" in (folder / "foxglove.json").read_text()
    (folder / "plotjuggler.xml").write_text("<root>mine</root>")
    assert main(["layouts", "--out", str(folder)]) == 2
    assert "was not written by" in capsys.readouterr().err
    assert (folder / "plotjuggler.xml").read_text() == "<root>mine</root>"
