"""YAML that bombs, calls or hides is refused at once, in one sentence, with little memory."""

import os
import resource
import time

import pytest
import yaml

import robots
from robot_energy.foundation.errors import ModelFileError
from robot_energy.model import load, parse_yaml


def doubling(levels):
    """Each line lists the one before nine times: 9^levels values out of a kilobyte."""
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, levels)]
    return "\n".join(lines)


BOMBS = [
    (doubling(12), "alias"),
    ("[" * 4_000_000, "more than 50 levels at line 1"),
    ("{a: " * 100_000, "more than 50 levels"),
    ("- " * 100_000, "more than 50 levels"),
    ("".join(" " * i + "a:\n" for i in range(2000)), "more than 50 levels at line 51"),
    ("- 1\n" * 1_000_000, "more than 200000 keys"),
    ("".join(f"k{i}: 1\n" for i in range(300_000)), "more than 200000 keys"),
    ("a: " + "x" * 2**23, "characters; expected at most"),
    ("a: 1" + ":59" * 100_000, "too many digits"),
    ("a: " + "9" * 100_000, "too many digits"),
    ("a: 99999999999999999999", "beyond 64 bits"),
    ("a: !!python/object/apply:os.system ['true']", "the YAML tag"),
    ("a: !!python/name:os.system", "the YAML tag"),
    ("a: !!binary aGk=", "the YAML tag"),
    ("%TAG ! tag:yaml.org,2002:python/object/\n---\na: !apply:os.system ['true']", "the YAML tag"),
    ("a: 1\n---\nb: 2", "another document"),
    ("a: 1\nb: {c: 1, c: 2}", "'c' is given twice, the second time at line 2"),
    ("a: 2020-99-99", "not valid YAML"),
    ("? [a]\n: b", "not valid YAML at line 1"),
    ("a: \0", "not valid YAML"),
    ("a: \ud800", "not valid YAML"),
]


@pytest.mark.parametrize(("text", "words"), BOMBS)
def test_a_document_that_is_no_model_is_refused_at_once(text, words):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    begin = time.process_time()
    with pytest.raises(ModelFileError, match=words) as caught:
        parse_yaml(text, "robot.yaml")
    assert time.process_time() - begin < 20
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 150 * 1024  # KiB
    assert "\n" not in str(caught.value)


def test_plain_values_come_out_as_they_stand():
    text = "a: 1\nb: 2.5e-3\nc: [true, ~, 'x']\n<<: {d: é}\n-9223372036854775808: least\n"
    expected = {"a": 1, "b": 2.5e-3, "c": [True, None, "x"], "d": "é", -(2**63): "least"}
    assert parse_yaml(text, "robot.yaml") == expected


def test_a_urdf_that_is_a_pipe_is_not_waited_for(tmp_path):

    os.mkfifo(tmp_path / "pipe.urdf")
    data = robots.two_link_data() | {"urdf": {"path": "pipe.urdf"}}
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(data))
    with pytest.raises(ModelFileError, match="cannot be read"):
        load(tmp_path / "robot.yaml")
