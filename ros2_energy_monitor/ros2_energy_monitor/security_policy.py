# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Access rights of every node for SROS 2, read from the nodes themselves.

Each node is started for an instant, on this computer only, with the parameters given; what it
publishes, subscribes, serves and calls becomes one enclave of an SROS 2 policy, and no more.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import Any
from xml.etree import ElementTree

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from robot_energy.foundation.errors import PageError, RobotEnergyError
from robot_energy.foundation.files.output_files import GENERATOR, FileKind, check_file, write_file
from robot_energy_report.page.hub import ACTIONS
from ros2_energy_monitor.base.run_node import ros
from ros2_energy_monitor.base.shared_memory import clear_ports
from ros2_energy_monitor.executables import EXECUTABLES

POLICY = (FileKind("policy", b"<?xml", f"<!-- {GENERATOR} -->".encode()),)
# Nodes that run for long, with what keeps them from files and other computers.
NODES: dict[str, dict[str, Any]] = {
    "torque_monitor": {"model": "kr16"},
    "friction_monitor": {"model": "kr16"},
    "power_monitor": {"model": "kr16", "state_folder": ""},
    "energy_monitor": {"model": "kr16", "state_folder": ""},
    "virtual_robot": {},
    "meter_driver": {"host": "127.0.0.1"},
    "energy_dashboard": {"address": "127.0.0.1", "port": 0},
    "energy_exporter": {"exporters": ["mqtt"], "mqtt.host": "127.0.0.1"},
    "energy_recorder": {"folder": "/dev/null/history"},
    "console": {},
}
DEFAULT_PROFILE = "shelly_pro_3em"
PATIENCE = 60.0  # until a node sees itself in the graph [s]


@dataclass(frozen=True)
class NodeRights:
    """Full names of what a node uses."""

    node: str
    publish: frozenset[str] = field(default_factory=frozenset[str])
    subscribe: frozenset[str] = field(default_factory=frozenset[str])
    reply: frozenset[str] = field(default_factory=frozenset[str])
    request: frozenset[str] = field(default_factory=frozenset[str])


def rights_of(node: Node) -> NodeRights:
    """Return what the graph says that a node uses."""
    own = node.get_name(), node.get_namespace()

    def names(listed: Iterable[tuple[str, Any]]) -> frozenset[str]:
        return frozenset(name for name, _ in listed)

    return NodeRights(
        node.get_fully_qualified_name(),
        names(node.get_publisher_names_and_types_by_node(*own)),
        names(node.get_subscriber_names_and_types_by_node(*own)),
        names(node.get_service_names_and_types_by_node(*own)),
        names(node.get_client_names_and_types_by_node(*own)),
    )


def is_seen(node: Node) -> bool:
    """Return whether the graph shows all that a node has made."""
    found = rights_of(node)
    return (
        {one.topic_name for one in node.publishers} <= found.publish
        and {one.topic_name for one in node.subscriptions} <= found.subscribe
        and {one.service_name for one in node.services} <= found.reply
        and {one.service_name for one in node.clients} <= found.request
    )


def policy_xml(rights: Iterable[NodeRights]) -> bytes:
    """Return an SROS 2 policy: one enclave for each node, named as the node."""
    policy = ElementTree.Element("policy", version="0.2.0")
    enclaves = ElementTree.SubElement(policy, "enclaves")
    for one in rights:
        enclave = ElementTree.SubElement(enclaves, "enclave", path=one.node)
        namespace, _, name = one.node.rpartition("/")
        profiles = ElementTree.SubElement(enclave, "profiles")
        profile = ElementTree.SubElement(profiles, "profile", ns=namespace or "/", node=name)
        for kind, right in (
            ("topic", "publish"), ("topic", "subscribe"), ("service", "reply"),
            ("service", "request"),
        ):  # fmt: skip
            found = sorted(getattr(one, right))
            if found:
                listed = ElementTree.SubElement(profile, f"{kind}s", {right: "ALLOW"})
                for full in found:
                    ElementTree.SubElement(listed, kind).text = full
    ElementTree.indent(policy)
    text = ElementTree.tostring(policy, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<!-- {GENERATOR} -->\n{text}\n'.encode()


def collect(args: Sequence[str], names: Sequence[str], has_file: bool) -> list[NodeRights]:
    """Return the rights of nodes in the order of their names, by starting one after the other.

    Each begins in a graph of its own, where no node of that name was before.

    Args:
        args: Command line of the nodes, from ``--ros-args`` on.
        has_file: Whether a parameter file is given, which then names the profile of the meter.
    """
    found: list[NodeRights] = []
    for name in names:
        # These subscribe and ask what they find.
        others = ["energy_monitor"] if name in ("energy_dashboard", "energy_recorder") else []
        with _running(args, [name, *others], has_file) as ((node, *seen), spin_until):
            if seen:
                spin_until(lambda node=node: any(True for _ in node.clients), "energy_monitor")
            for one in (node, *seen):
                spin_until(lambda node=one: is_seen(node), one.get_name())
            rights = rights_of(node)
            if getattr(getattr(node, "parameters", None), "allow_control", False):
                # What the buttons of the dashboard call; it makes a client when one is pressed.
                offered = rights_of(seen[0]).reply
                asked = {one for one in offered if one.rpartition("/")[2] in ACTIONS}
                rights = replace(rights, request=rights.request | asked)
            found.append(rights)
    return found


@contextmanager
def _running(
    args: Sequence[str], names: Sequence[str], has_file: bool
) -> Generator[tuple[list[Node], Callable[[Callable[[], bool], str], None]]]:
    """The nodes, and a function that executes them until a condition holds."""
    with ros(args) as context:
        executor, nodes = SingleThreadedExecutor(context=context), list[Node]()

        def spin_until(condition: Callable[[], bool], what: str) -> None:
            limit = time.monotonic() + PATIENCE
            while not condition():
                if time.monotonic() > limit:
                    raise PageError(
                        f"the graph does not show all of {what}", "nodes that see each other"
                    )
                executor.spin_once(timeout_sec=0.05)

        try:
            for name in names:
                overrides = dict(NODES[name])
                if name == "meter_driver" and not has_file:
                    overrides["profile"] = DEFAULT_PROFILE
                kind = name.title().replace("_", "")
                make: Callable[..., Node] = getattr(import_module(EXECUTABLES[name]), kind)
                given = [Parameter(key, value=value) for key, value in overrides.items()]
                nodes.append(make(context=context, parameter_overrides=given))
                executor.add_node(nodes[-1])
            yield nodes, spin_until
        finally:
            executor.shutdown()
            for node in nodes:
                node.destroy_node()


def main(args: Sequence[str] | None = None) -> int:
    """Return the exit code of writing the policy: 0; 2 if it cannot be made."""
    parser = argparse.ArgumentParser(
        prog="security_policy",
        description="Write an SROS 2 policy with the rights that each node needs. Parameter files "
        "and namespaces of the nodes follow after --ros-args, as for the nodes.",
    )
    parser.add_argument("--out", required=True, metavar="FILE", help="the policy (.xml)")
    parser.add_argument("--nodes", nargs="+", choices=NODES, default=list(NODES), metavar="NODE",
                        help=f"of {', '.join(NODES)} (default: all)")  # fmt: skip
    words = list(sys.argv[1:] if args is None else args)
    cut = words.index("--ros-args") if "--ros-args" in words else len(words)
    options, rest = parser.parse_args(words[:cut]), words[cut:]
    has_file = "--params-file" in rest
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "OFF"  # robots of the network do not count
    clear_ports()  # of a process that was killed
    try:
        check_file(options.out, POLICY, "the policy")
        found = collect(rest, options.nodes, has_file)
        write_file(options.out, policy_xml(found), POLICY, "the policy")
    except RobotEnergyError as error:
        print(f"security_policy: {error}", flush=True)
        return 2
    for one in found:
        print(
            f"{one.node}: {len(one.publish)} topics published, {len(one.subscribe)} subscribed; "
            f"{len(one.reply)} services offered, {len(one.request)} called",
            flush=True,
        )
    return 0
