import pytest
import yaml

import robots
from refusals import refused
from robot_energy.foundation.errors import ModelFileError, RobotEnergyError
from robot_energy.model import load, parse_yaml, save, validate
from robots import figure


def broken(path, value):
    """The two-link model with one entry replaced; None deletes it."""
    data = robots.two_link_data()
    part = data
    for key in path[:-1]:
        part = part[key]
    if value is None:
        del part[path[-1]]
    else:
        part[path[-1]] = value
    return data


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (("cabinet",), None, "key 'cabinet' is missing"),
        (("cabinet", "loss_dc", "value"), "much", "'cabinet.loss_dc.value' is 'much'.*number"),
        (("cabinet", "loss_dc", "value"), -1.0, "greater than or equal to 0"),
        (("cabinet", "loss_dc", "value"), True, "expected a number"),
        (("temperature", "fallback_degc"), 303.15, "less than or equal to 150"),  # kelvin
        (("cabinet", "loss_dc", "value"), float("nan"), "finite"),
        (("cabinet", "loss_dc", "tag"), "guessed", "'published', 'identified'"),
        (("cabinet", "los_dc"), figure(1.0), "'cabinet.los_dc' is unknown"),
        (("joints", 0, "gear_ratio"), figure(0.0), "joints.shoulder: gear_ratio must not be 0"),
        (("joints", 1, "name"), "shoulder", "joint names repeat"),
        (("coupling", 0, "joint"), "wrist", "unknown joint 'wrist'"),
        (("schema_version",), 2, "schema_version 2; expected 1"),
        (("joints", 0, "friction", "viscous", "law"), "magic", "magic"),
        (("joints", 0, "friction", "viscous", "fitted_degc"), [80, 20], "fitted_degc must rise"),
        (("urdf",), {"path": "nowhere.urdf"}, "nowhere.urdf"),
        (("urdf",), {}, "one of path, xml and topic"),
    ],
)
def test_wrong_entry_is_named_with_found_and_expected(path, value, words):
    with pytest.raises(ModelFileError, match=words) as caught:
        validate(broken(path, value), "robot.yaml")
    assert "robot.yaml" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: [1", "not valid YAML at line"),
        ("a: 1\na: 2", "'a' is given twice"),
        ("a: &x 1\nb: *x", "alias"),
        ("!!python/object/apply:os.system ['true']", "the YAML tag"),
        ("- 1", "is a list"),
        ("", "is empty; expected a mapping with schema_version, robot, urdf, joints, cabinet"),
        ("[" * 100_000, "more than 50 levels"),
    ],
)
def test_hostile_yaml_is_refused(text, words):
    with pytest.raises(ModelFileError, match=words):
        validate(parse_yaml(text, "robot.yaml"), "robot.yaml")


def test_missing_file_names_the_shipped_models():
    with refused(RobotEnergyError, found="'no_such_robot'", remedy="kr16"):
        load("no_such_robot")


def test_saved_model_reads_back_equal(tmp_path):
    model = robots.two_link()
    save(model, tmp_path / "copy.yaml")
    assert load(tmp_path / "copy.yaml").model_id == model.model_id


def test_model_id_changes_with_any_figure_and_with_the_urdf(tmp_path):
    ids = {robots.two_link().model_id}
    ids.add(validate(broken(("cabinet", "loss_dc"), figure(20.5)), "x").model_id)
    urdf = robots.TWO_LINK_URDF.replace('mass value="4.0"', 'mass value="4.1"')
    ids.add(robots.two_link(urdf={"xml": urdf}).model_id)
    assert len(ids) == 3


def test_relative_urdf_path_starts_at_the_model_file(tmp_path):
    (tmp_path / "arm.urdf").write_text(robots.TWO_LINK_URDF)
    data = {**robots.two_link_data(), "urdf": {"path": "arm.urdf"}}
    (tmp_path / "arm.yaml").write_text(yaml.safe_dump(data))
    assert load(tmp_path / "arm.yaml").urdf_xml == robots.TWO_LINK_URDF
