"""Why the gantry needs a larger share of the arm's energy here than in paper B."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from xml.etree import ElementTree

from robot_energy.model import RobotModel, load
from robot_energy.model.joint import Joint
from robot_energy.timeline.blocks import Float
from robot_energy_papers.machines import ARM, MACHINES, Energies, layer, predicted, wall_motion
from robot_energy_papers.models import with_friction_times, with_values
from robot_energy_papers.sensitivity import SensitivityTable, Values, open_figures, sensitivity
from robot_energy_plan.motion import Trajectory
from robot_energy_plan.motion.tool_motion import ToolLimits

GANTRY = "testbed"
QUANTITIES = ("mechanical, magnitude", "electrical, drives")
TRUSS = 12  # strokes of the assumed infill, along the wall and back
RAM = 100.0  # kg, of the shipped gantry
DRAWS, QUICK_DRAWS = 300, 10  # of all open figures at once; 12 motions in the full form

MACHINE_FIGURES = open_figures(
    ("force_x", "gantry: Coulomb friction of the long axis", "N", 120.0, 300.0, 450.0,
     "rails 0.003 to 0.01 of the weight, eight seals of 5 to 15 N, one rack or two with preload"),
    ("force_y", "gantry: Coulomb friction of the cross axis", "N", 60.0, 150.0, 225.0,
     "as the long axis, 250 kg on four carriages"),
    ("gantry_viscous", "gantry: viscous friction, factor", "", 0.3, 1.0, 2.0,
     "oil of the gears from hot and thin to cold and thick, or gears with grease"),
    ("gantry_mass", "gantry: moving bodies, factor", "", 0.5, 1.0, 1.5,
     "published: 2.5 t in all; bridge, carriage and ram of 300 to 900 kg"),
    ("ram", "gantry: weight of the ram on its motor", "kg", 0.0, 100.0, 150.0,
     "0: a brake or a counterweight holds it; 150 kg: with print head and full hose"),
    ("gantry_copper", "gantry: winding loss per torque squared, factor", "", 0.3, 1.0, 2.0,
     "a motor one size larger or smaller"),
    ("gantry_ratio", "gantry: motor turn per metre, factor", "", 0.6, 1.0, 1.5,
     "gear 6 to 15 before a pinion of 30 mm"),
    ("amplifier", "all: constant loss of an amplifier, factor", "", 0.0, 1.0, 1.5,
     "0: power at the terminals of the motor, as paper B measures it; 12 W: large amplifiers"),
    ("arm_mass", "arm: moving bodies, factor", "", 0.85, 1.0, 1.15,
     "published: the mass of the whole arm; how it divides is of another maker's robot"),
    ("head", "arm: print head", "kg", 0.0, 20.0, 40.0, "nothing up to the rated payload"),
    ("arm_coulomb", "arm: Coulomb friction, factor", "", 0.5, 1.0, 2.0,
     "1.5 to 6 % of the effort limit, usual for gears of arms"),
    ("arm_viscous", "arm: viscous friction, factor", "", 0.5, 1.0, 2.0,
     "gears from 15 to 45 degC"),
    ("arm_copper", "arm: winding loss per torque squared, factor", "", 0.5, 1.0, 2.0,
     "a motor one size larger or smaller; the simulator may have none"),
    ("arm_ratio", "arm: gear ratios, factor", "", 0.8, 1.0, 1.25,
     "motors of 2800 to 4400 rpm at the published top speed"),
)  # fmt: skip
MOTION_FIGURES = open_figures(
    ("distance", "arm: base to the near side of the wall", "m", 1.0, 1.3, 1.6,
     "what the arm can reach with the whole wall; the paper shows it in a lost figure"),
    ("height", "arm: base above the bottom of the wall", "m", -0.2, 0.2, 0.8,
     "on the floor, or on a pedestal as for a wall of 1 m"),
    ("acceleration", "all: acceleration in corners", "m/s^2", 0.5, 2.0, 5.0,
     "not stated; slow for fresh concrete, fast for a robot of 40 kg"),
    ("infill", "all: passes of a zigzag inside the outline", "", 0.0, 0.0, 1.0,
     f"not stated; a truss of {TRUSS} strokes along the wall and back"),
)  # fmt: skip
IN_BOTH_FORMS = ("force_x", "ram", "head", "arm_copper")


def wall_tables(quick: bool) -> dict[str, SensitivityTable]:
    """Return what the energy of the gantry over that of the arm owes to open figures.

    By measure of energy; one layer at the bottom of the wall, shipped models.

    Args:
        quick: Only figures that change no motion, those with the largest effect.
    """
    share = 1.0 + float(MACHINES[GANTRY].paper or 0.0)
    published: dict[str, float] = dict.fromkeys(QUANTITIES, share)
    only = IN_BOTH_FORMS if quick else None
    return sensitivity(
        _over_arm,
        MACHINE_FIGURES + MOTION_FIGURES,
        published,
        only=only,
        draws=QUICK_DRAWS if quick else DRAWS,
        slow=[figure.key for figure in MOTION_FIGURES],
    )


def _over_arm(values: Values) -> dict[str, float]:
    """Energy of the gantry over that of the arm by measure. [-]"""
    gantry, arm = _gantry(values), _arm(values)
    place = {figure.key: values[figure.key] for figure in MOTION_FIGURES}
    ours, theirs = (_energy(key, model, **place) for key, model in ((GANTRY, gantry), (ARM, arm)))
    return {name: ours[name] / theirs[name] for name in QUANTITIES}


def _energy(
    key: str, model: RobotModel, distance: float, height: float, acceleration: float, infill: float
) -> dict[str, float]:
    """Energy of one layer, and of its share of an infill. [J]"""
    if key == GANTRY:
        distance = height = 0.0

    def of(strokes: int) -> Energies:
        return predicted(model, _motion(key, distance, height, acceleration, strokes))[0]

    outline = of(0).figures
    if not infill:
        return outline
    filled = of(TRUSS).figures
    return {name: outline[name] + infill * (filled[name] - outline[name]) for name in outline}


@cache
def _motion(
    key: str, distance: float, height: float, acceleration: float, strokes: int
) -> tuple[tuple[Float, Trajectory], ...]:
    """The blocks of a motion, which is planned once."""
    machine = MACHINES[key]
    place, limits = machine.placement, ToolLimits(acceleration=acceleration)
    if key == ARM:
        place = replace(place, y=-distance, z=-height)
    if (place, limits, strokes) == (machine.placement, ToolLimits(), 0):
        return layer(key)
    machine = replace(machine, placement=place)
    return tuple(wall_motion(machine, infill=strokes, limits=limits).blocks())


def _gantry(values: Values) -> RobotModel:
    model = load(MACHINES[GANTRY].model)
    factors = {
        "ratio": values["gantry_ratio"],
        "viscous": values["gantry_viscous"],
        "copper": values["gantry_copper"],
        "amplifier": values["amplifier"],
    }
    first, second, ram = model.joints
    force_x, force_y = (
        joint.friction.coulomb.value * joint.gear_ratio.value for joint in (first, second)
    )
    # The ram stands still while a layer is printed: its copper loss is that of the weight it holds.
    carried = values["ram"] / (RAM * values["gantry_mass"])
    joints = (
        _changed(first, coulomb=values["force_x"] / force_x, **factors),
        _changed(second, coulomb=values["force_y"] / force_y, **factors),
        _changed(ram, **{**factors, "copper": factors["copper"] * carried**2}),
    )
    return _with_masses(model.changed(joints=list(joints)), values["gantry_mass"])


def _arm(values: Values) -> RobotModel:
    model = load(MACHINES[ARM].model)
    named = ("arm_ratio", "arm_coulomb", "arm_viscous", "arm_copper", "amplifier")
    joints = [_changed(joint, *(values[name] for name in named)) for joint in model.joints]
    head = model.payload[0]
    share = values["head"] / head.mass
    moments = tuple(share * moment for moment in head.inertia)
    loaded = head.model_copy(update={"mass": values["head"], "inertia": moments})
    return _with_masses(model.changed(joints=joints, payload=(loaded,)), values["arm_mass"])


def _changed(
    joint: Joint,
    ratio: float = 1.0,
    coulomb: float = 1.0,
    viscous: float = 1.0,
    copper: float = 1.0,
    amplifier: float = 1.0,
) -> Joint:
    """A joint with factors on its figures; the gear ratio changes no Coulomb force of the joint."""
    losses = joint.losses
    assert losses is not None  # of all shipped models of paper B
    constant = losses.constant.value * amplifier
    update = {
        "friction": with_friction_times(joint, coulomb / ratio, viscous),
        "losses": with_values(losses, copper=losses.copper.value * copper, constant=constant),
    }
    joint = with_values(joint, gear_ratio=joint.gear_ratio.value * ratio)
    return joint.model_copy(update=update)


def _with_masses(model: RobotModel, factor: float) -> RobotModel:
    """The model with mass and moments of every body times a factor."""
    root = ElementTree.fromstring(model.urdf_xml)
    for inertial in root.iter("inertial"):
        for part in inertial:
            for name, text in part.attrib.items():
                if part.tag in ("mass", "inertia"):
                    part.set(name, repr(float(text) * factor))
    text = ElementTree.tostring(root, encoding="unicode")
    return model.changed().with_urdf(text, f"{model.robot.type}, bodies times {factor:g}")
