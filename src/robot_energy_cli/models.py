"""`robot-energy models`: list shipped models, check a model file, begin one."""

from __future__ import annotations

import os
import sys
from argparse import Namespace
from pathlib import Path

from robot_energy_cli.command import REQUIRED, Command, Group, Options
from robot_energy_cli.terminal import JSON_OPTION, check_outputs, console, present, wrote

INIT: Options = {
    "source URDF|XACRO|BAG": "file or bag with the URDF",
    "arguments NAME:=VALUE": ("arguments of the xacro file", {"nargs": "*"}),
    "--out FILE": ("model file to write; it must not exist", REQUIRED),
    "--class": (
        "priors to take (default: by peak power and mass)",
        {"dest": "robot_class", "choices": ("cobot", "industrial")},
    ),
    "--joints NAMES": "joints to model, separated by commas (default: all that move, without "
    "gripper; of a bag, those in its joint states)",
}


def _run_list(args: Namespace) -> int:
    from robot_energy.model import load, shipped_models
    from robot_energy.results.base import count_tags
    from robot_energy_report.formats import tags_text

    out, models = console(), shipped_models()
    for name, path in models.items():
        model = load(path)
        tags = tags_text(count_tags(model))
        out.print(f"{name:<8} {model.robot.type}; {len(model.joints)} joints; figures: {tags}")
    for folder in sorted({path.parent for path in models.values()}):
        out.print(f"files in {folder}")
    return 0


def _run_check(args: Namespace) -> int:
    from robot_energy.model import load
    from robot_energy.physics.rigid_body import Robot
    from robot_energy_report.model import model_report

    check_outputs(args, [args.model])
    model = load(args.model)
    present(args, model_report(model, Robot.from_model(model)))
    return 0


def _run_schema(args: Namespace) -> int:
    import json

    from robot_energy_cli.model_reference import json_schema, reference_page

    text = reference_page() if args.markdown else json.dumps(json_schema(), indent=2) + "\n"
    sys.stdout.write(text)
    return 0


def _run_init(args: Namespace) -> int:
    from robot_energy.foundation.config_file import parse_yaml
    from robot_energy.foundation.errors import ModelFileError
    from robot_energy.foundation.files.output_files import TEXT, write_file
    from robot_energy.model import validate
    from robot_energy.physics.rigid_body import Robot
    from robot_energy_identify.starter import read_arm, read_description, starter_text
    from robot_energy_identify.starter.model_remarks import implausible

    out = Path(args.out)
    if os.path.lexists(out):
        raise ModelFileError(
            f"'{out}' exists",
            "a new file, since first models are edited by hand",
            "choose another name, or remove the file",
        )
    check_outputs(args, [args.source], args.out)
    description = read_description(args.source, args.arguments)
    names = args.joints.split(",") if args.joints else description.joint_names
    arm = read_arm(description.xml, args.robot_class, names)
    text = starter_text(arm, description, out.parent)
    model = validate(parse_yaml(text, str(out)), str(out))
    remarks = dict.fromkeys([*arm.remarks, *implausible(model, Robot.from_model(model))])
    write_file(out, text.encode(), TEXT, "the model file", ModelFileError)
    show = console().print
    show(
        f"{arm.robot_name}: {len(arm.joints)} joints, {arm.moving_mass:.1f} kg, class "
        f"{arm.robot_class.name} ({arm.class_source})"
    )
    for name, why in arm.left_out:
        show(f"- not modelled: {name} ({why})")
    for remark in remarks:
        show(f"- {remark}")
    wrote(console(), out, "model file")
    show(
        "All figures that the URDF does not give are assumed. Next:\n"
        f"  robot-energy replay BAG --model {out}\n"
        f"  robot-energy check BAG --model {out} --effort MEANING\n"
        f"  robot-energy identify all BAGS... --model {out} --effort MEANING "
        "--out identified.yaml\n"
        "MEANING is what your driver sends as effort: motor_torque, joint_torque or motor_current."
    )
    return 0


def _group(name: str, text: str, description: str) -> Group:
    """One of the two names; both have all actions."""
    listing = "list", "list shipped models (default)", _run_list
    return Group(name, text, description, "actions", "ACTION", lambda: ACTIONS, listing)


ACTIONS = (
    Command(
        "check",
        "validate a model file and print what it models",
        _run_check,
        {"model FILE|NAME": "model file, or name of a shipped one", **JSON_OPTION},
        "Validate a model file with its URDF and print what is modelled, and how "
        "many of its figures are published, identified, derived or assumed.",
    ),
    Command(
        "schema",
        "print the JSON schema of model files",
        _run_schema,
        {"--markdown": "print the reference page instead"},
        "Print the JSON schema of model files, for editors that complete and check "
        "YAML, or the same as a page of Markdown.",
    ),
    Command(
        "init",
        "begin a model file from a URDF, a xacro file or a bag",
        _run_init,
        INIT,
        "Write a complete model file of a robot nobody has measured: gears, rotors, "
        "friction, drives and cabinet are assumed, scaled from the limits in its URDF.",
    ),
)
LIST = _group("models", "list the shipped models", "List the models that come with the tool.")
MODEL = _group(
    "model",
    "check a model file; begin one from a URDF; its schema",
    "Check a model file (model check), begin one from a URDF (model init), or print the schema "
    "of model files.",
)
