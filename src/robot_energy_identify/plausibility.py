"""Gates: what identification refuses to write, because no robot can be so.

A fit always gives figures, also to data with a wrong sign. Each gate here compares with what
physics or the URDF says, and refuses only what is grossly wrong: a doubtful fit is for the
held-out errors to show. Nothing is written once a gate has refused.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.errors import ImplausibleIdentificationError
from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy.model.friction_laws import FRICTION_LAWS
from robot_energy.timeline.blocks import EffortMeaning, Float, TorqueBlock
from robot_energy_identify.cabinet.cabinet import CabinetFit
from robot_energy_identify.data.recordings import Recording
from robot_energy_identify.data.rest import still_joints
from robot_energy_identify.drives.drive_data import DriveData
from robot_energy_identify.drives.drives import DrivesFit
from robot_energy_identify.drives.total_sums import Sums
from robot_energy_identify.dynamics.dynamics import Dynamics
from robot_energy_identify.dynamics.validation import TorqueError
from robot_energy_identify.friction.friction import (
    MIN_NEGATIVE_SHARE,
    MIN_NEGATIVE_STD,
    FrictionFit,
)
from robot_energy_identify.stats.cross_validation import EnergyScore, rms_of
from robot_energy_identify.stats.regression import qr_r

Usable = NDArray[np.bool_]

# Share of a torque's variance that gravity, inertia and friction of opposite sign explain
# more than those of the right sign, from which on the sign is wrong. Right signs give -0.65
# at the most, and so wrong ones 0.65 at the least, on the robots and rigs tried.
MIN_OPPOSITE_SHARE = 0.3
MIN_SAMPLES = 100  # moving samples of a joint, below which nothing is said of its sign
MAX_HELD_OUT = 1.0  # error over what was measured: a prediction of zero is off by 1
# Torque of the identified bodies over that of the URDF's in the same motion, either way. URDFs
# of makers are within tens of per cent; rough ones, of links as solid boxes, within a factor
# of two; a wrong unit or a gear ratio left out is off by far more.
MAX_BODY_FACTOR = 3.0
# One link's mass over that of the URDF: torque determines single masses only in sums, so one link
# may take what is of its neighbours.
MAX_LINK_FACTOR = 10.0
# Shift of a link's centre of mass over the link's size in the URDF, which is the radius of gyration
# about its joint: torque determines first moments only in sums, so neighbours exchange some.
MAX_CENTRE_FACTOR = 3.0
MIN_LINK_SHARE = 0.1  # of the moving mass, below which a link's factor says nothing
DIAGONAL = [4, 6, 9]  # of the inertia about the joint, among the parameters of a link
MIN_POWER_CORRELATION = -0.5  # of a drive's power with its shaft power; it is near 1

REMEDIES = {
    EffortMeaning.MOTOR_CURRENT: "turn the sign of torque_constant of {joints} in the model file",
    EffortMeaning.MOTOR_TORQUE: (
        "turn the sign of gear_ratio of {joints} in the model file if the motor turns the other "
        "way, else turn the sign of the torque of {joints} in the recording"
    ),
}
TURN = "turn the sign of the torque of {joints} in the recording"


def opposite_joints(
    names: Sequence[str], measured: Float, rigid: Float, velocity: Float, usable: Usable
) -> dict[str, float]:
    """Return the joints whose torque has the opposite sign of what the model expects.

    ``s measured = a rigid + b sign(v) + c v + offset`` with a, b, c >= 0 is fitted for s = +1
    and s = -1: bodies of any size and friction of any size, but never of the wrong sign.

    Args:
        measured: Torque, shape (N, n). [N m]
        rigid: Torque of the bodies as given, same side, shape (N, n). [N m]
        velocity: Of the same side, shape (N, n). [rad/s]
        usable: Moving samples with a known torque, shape (N, n).

    Returns:
        Correlation of the torque with what is expected, by joint. [-]
    """
    found: dict[str, float] = {}
    for joint, name in enumerate(names):
        rows = usable[:, joint]
        if int(rows.sum()) < MIN_SAMPLES:
            continue
        speed = velocity[rows, joint]
        columns = np.column_stack([rigid[rows, joint], np.sign(speed), speed])
        right, wrong = (_explained(columns, sign * measured[rows, joint]) for sign in (1.0, -1.0))
        if wrong - right > MIN_OPPOSITE_SHARE:
            found[name] = -float(np.sqrt(wrong))
    return found


def _explained(columns: Float, target: Float) -> float:
    """Share of a variance that columns with coefficients >= 0 explain. [-]"""
    from scipy.optimize import nnls

    columns, target = columns - columns.mean(axis=0), target - target.mean()
    size = np.linalg.norm(columns, axis=0)
    columns = columns / np.where(size > 0.0, size, 1.0)
    triangle = qr_r(np.column_stack([columns, target]))
    left = float(nnls(triangle[:, :-1], triangle[:, -1])[1])
    total = float(target @ target)
    return 1.0 - left**2 / total if total > 0.0 else 0.0


def _refuse_opposite(found: Mapping[str, float], joints: int, remedy: str = TURN) -> None:
    if not found:
        return
    which = "all joints" if len(found) == joints else ", ".join(found)
    values = ", ".join(f"{name} {value:.2f}" for name, value in found.items())
    raise ImplausibleIdentificationError(
        f"the measured torque of {which} is opposite in sign to gravity, inertia and friction "
        f"(correlation {values})",
        "torque that lifts against gravity and drives against friction, correlation above 0",
        remedy.format(joints=which),
    )


def check_signs(recordings: Sequence[Recording], effort: EffortMeaning | None = None) -> None:
    """Refuse recordings whose measured torque has the wrong sign."""
    model, torque = recordings[0].model, TorqueBlock.concatenate([p.torque for p in recordings])
    measured, rigid = torque.motor_torque_measured, torque.motor_torque_rigid
    sound = np.concatenate([part.sound for part in recordings])
    moving = ~np.concatenate([still_joints(part) for part in recordings])
    usable = moving & sound[:, None] & np.isfinite(measured) & np.isfinite(rigid)
    found = opposite_joints(model.joint_names, measured, rigid, torque.motor_velocity, usable)
    remedy = TURN if effort is None else REMEDIES.get(effort, TURN)
    _refuse_opposite(found, len(model.joints), remedy)


def check_dynamics(result: Dynamics, held_out: TorqueError) -> None:
    """Refuse dynamics that no robot has.

    Args:
        held_out: Torque error of its model file on what it has not seen.
    """
    robot, rows = result.torque_model.robot, result.observations
    bodies = rows.regressor[:, :, : 10 * robot.n_joints] @ robot.link_parameters.ravel()
    usable = rows.used & np.isfinite(rows.joint_torque)
    found = opposite_joints(
        result.model.joint_names, rows.joint_torque, bodies, rows.motion.joint_velocity, usable
    )
    _refuse_opposite(found, robot.n_joints)
    if not held_out.total < MAX_HELD_OUT:
        raise ImplausibleIdentificationError(
            f"the identified dynamics are {100 * held_out.total:.0f} % off the torque that their "
            "fit has not seen, which is no better than predicting zero",
            "a fit that predicts torque",
            "check signs and sizes of the gear ratios, joint order and zero positions",
        )
    labels = result.exported_base.labels
    values, std = result.exported.values, result.exported.std
    bad: list[str] = []
    for column, owner, name in result.torque_model.extra:
        if column.kind not in ("viscous", "coulomb") or name not in labels:
            continue
        used = rows.used[:, owner]
        part = rows.regressor[used, owner, rows.names.index(name)]
        place = labels.index(name)
        share = abs(values[place]) * rms_of(part) / rms_of(rows.joint_torque[used, owner])
        if _negative(float(values[place]), float(std[place])) and share > MIN_NEGATIVE_SHARE:
            bad.append(f"{name} {values[place]:.3g} +- {std[place]:.1g} {column.unit}")
    if bad:
        raise _negative_friction(bad)
    _refuse_mass(result, robot.link_parameters.ravel())


def check_friction(fits: Sequence[FrictionFit]) -> tuple[list[FrictionFit], list[str]]:
    """Leave out axes whose friction drives instead of braking; refuse what predicts nothing.

    A viscous law over temperature is >= 0 by its fit, so only a constant is judged.

    Returns:
        The axes that brake, and why the others do not, one sentence each.
    """
    kept: list[FrictionFit] = []
    refused: list[ImplausibleIdentificationError] = []
    for fit in fits:
        figures = [("Coulomb", fit.coulomb, fit.coulomb_std, abs(fit.coulomb))]
        if not FRICTION_LAWS[fit.chosen].follows_temperature:
            size = abs(fit.viscous) * fit.speed
            figures.append(("viscous", fit.viscous, fit.viscous_std, size))
        bad = [
            f"{name} friction of {fit.name} {value:.3g} +- {std:.1g}"
            for name, value, std, size in figures
            if _negative(value, std) and size > MIN_NEGATIVE_SHARE * fit.torque
        ]
        if bad:
            refused.append(_negative_friction(bad))
        else:
            kept.append(fit)
    if refused and not kept:
        raise refused[0]
    lost = [fit.name for fit in kept if not fit.errors[fit.chosen].rms < MAX_HELD_OUT * fit.torque]
    if lost and len(lost) == len(kept):
        raise ImplausibleIdentificationError(
            f"the identified friction of {', '.join(lost)} predicts torque that its fit has not "
            "seen no better than zero",
            "friction torque that follows speed and temperature",
            "check the meaning of the effort, the gear ratios, and the bodies of the URDF",
        )
    return kept, [str(error) for error in refused]


def _negative(value: float, std: float) -> bool:
    return value < 0.0 and -value > MIN_NEGATIVE_STD * std


def _negative_friction(bad: Sequence[str]) -> ImplausibleIdentificationError:
    return ImplausibleIdentificationError(
        f"friction comes out negative: {'; '.join(bad)}",
        "friction that takes power at every speed",
        "check the sign of the measured torque, the gear ratios, and the bodies of the URDF",
    )


def _refuse_mass(result: Dynamics, given: Float) -> None:
    rows = result.observations
    regressor = rows.regressor[:, :, : len(given)]
    found = result.standard[: len(given)]
    before, after = given[::10], found[::10]
    total = float(before.sum())
    # torque determines masses only in sums; what it does not determine stays as in the URDF: so the
    # torque of all bodies is compared
    ratio = rms_of((regressor @ found)[rows.used]) / rms_of((regressor @ given)[rows.used])
    if not 1.0 / MAX_BODY_FACTOR < ratio < MAX_BODY_FACTOR:
        raise ImplausibleIdentificationError(
            f"the identified bodies take {ratio:.2g} times the torque that those of the URDF "
            f"take in the same motion (moving mass {after.sum():.3g} kg, URDF {total:.3g} kg)",
            f"a factor of at most {MAX_BODY_FACTOR:g} either way",
            "check the scale of the torque (torque_constant, gear_ratio, unit) or the masses of "
            "the URDF",
        )
    for name, old, new in zip(result.model.joint_names, before, after, strict=True):
        heavy = new > MIN_LINK_SHARE * total and new > MAX_LINK_FACTOR * old
        if heavy and old > 0.0:
            raise ImplausibleIdentificationError(
                f"the identified mass of the link behind {name} is {new:.3g} kg, {new / old:.2g} "
                f"times the {old:.3g} kg of the URDF",
                f"a factor of at most {MAX_LINK_FACTOR:g}",
                "check signs and sizes of the gear ratios, zero positions, and the masses of "
                "the URDF",
            )
    for name, old, new in zip(
        result.model.joint_names, given.reshape(-1, 10), found.reshape(-1, 10), strict=True
    ):
        if not (old[0] > 0.0 and new[0] > MIN_LINK_SHARE * total):
            continue
        size = float(np.sqrt(old[DIAGONAL].sum() / (2.0 * old[0])))
        shift = float(np.linalg.norm(new[1:4] / new[0] - old[1:4] / old[0]))
        if shift > MAX_CENTRE_FACTOR * size:
            raise ImplausibleIdentificationError(
                f"the identified centre of mass of the link behind {name} is {shift:.2g} m off "
                f"that of the URDF, {shift / size:.2g} times the size of the link, {size:.2g} m",
                f"a shift of at most {MAX_CENTRE_FACTOR:g} times its size",
                "check signs and sizes of the gear ratios, zero positions, and the centres of mass "
                "of the URDF",
            )


def check_drives(data: DriveData, fit: DrivesFit) -> None:
    """Refuse drives whose measured power contradicts their shaft power."""
    found: dict[str, float] = {}
    for joint, name in enumerate(data.names):
        rows = data.usable[:, joint]
        shaft, power = data.shaft_power[rows, joint], data.drive_power[rows, joint]
        if len(shaft) < MIN_SAMPLES or not (np.ptp(shaft) > 0.0 and np.ptp(power) > 0.0):
            continue
        correlation = float(np.corrcoef(shaft, power)[0, 1])
        if correlation < MIN_POWER_CORRELATION:
            found[name] = correlation
    if found:
        values = ", ".join(f"{name} {value:.2f}" for name, value in found.items())
        raise ImplausibleIdentificationError(
            f"the measured power of drives falls where torque times speed rises (correlation "
            f"{values})",
            "electrical power positive into the drive",
            f"turn the sign of the power, or of the torque, of {', '.join(found)}",
        )
    for comparison in fit.comparisons:
        way = DRIVE_MODELS[fit.chosen].way or fit.chosen
        if comparison.split != "beyond" and not (
            comparison.scores[way].rms < MAX_HELD_OUT * comparison.size
        ):
            raise ImplausibleIdentificationError(
                f"the identified drives are {comparison.scores[way].rms:.3g} W off the power that "
                "their fit has not seen, which is no better than predicting zero",
                "power that follows torque and speed",
                "check the order of the drives (--drive-joints) and the meaning of the effort",
            )


def check_total(data: Sums, scores: Mapping[str, EnergyScore]) -> None:
    """Refuse losses from one meter that predict it no better than zero does."""
    score = scores.get("identified")
    size = rms_of(data.measured)
    if score is not None and not score.rms < MAX_HELD_OUT * size:
        raise ImplausibleIdentificationError(
            f"the identified losses are {score.rms:.3g} W off the readings that their fit has not "
            "seen, which is no better than predicting zero",
            "a meter that follows the motion",
            "check the sign, the unit and the clock of the meter",
        )


def check_cabinet(fit: CabinetFit) -> None:
    """Refuse a cabinet that gives power while nothing moves."""
    for level, when in ((fit.hold, "stands still"), (fit.generating, "brakes")):
        if level is not None and _negative(level.power, level.std):
            raise ImplausibleIdentificationError(
                f"the meter reads {level.power:.1f} +- {level.std:.1g} W less drives while the "
                f"robot {when}",
                "constant losses above 0",
                "turn the sign of the meter (meter.sign: load_negative) or check its place",
            )
