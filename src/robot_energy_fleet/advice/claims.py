"""What each change would save in the recordings, with its 90 % band.

A saving is ``S = sum over the recording of (power now - power with the change) dt`` and errs by
``sum_k D_k x_k`` with independent ``x_k`` of variance 1, as in
`robot_energy_plan.optimization.deviations`; what both powers have in common cancels in ``D_k``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated

import numpy as np

from robot_energy.certainty.deviation import Z90
from robot_energy.certainty.friction_certainty import FrictionCertainty
from robot_energy.foundation.described import Described
from robot_energy.model import RobotModel
from robot_energy.physics.friction import FrictionModel
from robot_energy.timeline.blocks import Float, Int
from robot_energy_fleet.advice.evidence import (
    DEGC_MIDDLES,
    DEMAND_BINS,
    LONG_REST,
    MIN_BAGS,
    RecordedEvidence,
    RecordedRest,
)
from robot_energy_plan.optimization.chain import PowerChain
from robot_energy_plan.optimization.deviations import FORM_FED_BACK
from robot_energy_plan.optimization.rest_states import RestState, break_even, rest_cost
from robot_energy_report.formats import percent, watt_hours

STUDENT = {3: 2.920, 4: 2.353, 5: 2.132}
"""95 % quantile of Student's t by number of bags; fewer than three say nothing of their spread."""
NIGHT = 3600.0  # s; a rest as long as that is a night or a break in production
REGENERATION = (0.9, 0.05)  # share that a regenerative supply returns, assumed; its deviation
FORM_OF_POSE = 0.5  # standard deviation of what holding costs above brakes, as a share of it
FORM_OF_WARMING = 0.25  # the same of the friction that warmth saves
FORM_OF_COPPER = 0.5  # the same of what warm windings lose more
MAGNETS = 1.5  # warm magnets are weaker, 0.1 %/K: the current squared rises by half as much again,
# where the model does not have the fall of the torque constant, and with it this current
FORM_OF_STARTS = 0.25  # the same of what a shared bus saves: starts are never quite independent
MOST_ROBOTS = 4  # on one DC bus, of which something is said
FORM_OF_STANDING = 0.05  # the same of losses that flow all the time: warmth may start a fan
METER = 0.02  # standard deviation of a measured power that holds for long, as a share of it
WARM = 0.95  # of the motion was colder than the warm robot
MIN_WARMING = 3.0  # K between the mean and the warm motor, below which nothing is said
SAME_PLACE = 0.05  # rad or m; rests nearer than this are at one place
MIN_COMPARED = 5.0  # s of a meter at one place, from which on it counts


class Claim(Described):
    """What one change saves in the recordings."""

    name: str
    energy: Annotated[float, "Saved, positive where it is less. [J]"]
    columns: Annotated[Float, "Its change with the error of each figure, shape (K,). [J]"]
    sure: Annotated[str, "``measured``, ``predicted`` or ``assumed``: what it rests on."]
    found: str
    change: str
    command: Annotated[str, "Next command; empty where there is none."] = ""
    joint_position: Annotated[Float | None, "Where to wait, shape (n,). [rad] or [m]"] = None
    places: Annotated[Float | None, "Of the waits that count, shape (P, n). [rad] or [m]"] = None
    motor_temperature_degc: Annotated[Float | None, "Of the warm robot, shape (n,). [degC]"] = None
    state: Annotated[RestState | None, "In which to rest; None for other changes."] = None

    @property
    def half(self) -> float:
        """Half width of the 90 % band. [J]"""
        return Z90 * float(np.sqrt((self.columns**2).sum()))


def standby(
    evidence: RecordedEvidence, model: RobotModel, states: Sequence[RestState], assumed: bool
) -> Claim | None:
    """Return what the best state saves in long rests; None without any.

    ``S = sum_rests P_hold t - P_brakes (p (t - t_wake) + p_wake t_wake)``.
    """
    long = [rest for rest in evidence.rests if rest.duration >= LONG_REST]
    if not long or not states:
        return None
    chain = _chain(model, evidence)
    brakes = chain.rests(long[0].joint_position[None, :], holding=False)
    held = np.array([rest.energy / rest.duration for rest in long])
    compared = sum(rest.compared_time for rest in long)
    metered = compared >= MIN_COMPARED
    if metered:
        offset = sum(rest.measured - rest.predicted for rest in long) / compared
        lower = float(brakes.energy[0]) + offset
        common = np.zeros_like(brakes.columns[0])
        held += offset
    else:
        lower, common = float(brakes.energy[0]), brakes.columns[0]
    time = np.array([rest.duration for rest in long])
    best: tuple[float, Float, RestState, int] | None = None
    others: list[str] = []
    for state in states:
        costs = [rest_cost(state, duration) for duration in time.tolist()]
        saved, on_brakes, errors, used, used_time = 0.0, 0.0, np.zeros(2), 0, 0.0
        for power, duration, cost in zip(held.tolist(), time.tolist(), costs, strict=True):
            if cost is None or (gain := power * duration - lower * cost.held) <= 0.0:
                continue
            saved, used, used_time = saved + gain, used + 1, used_time + duration
            on_brakes += cost.held
            errors += lower * cost.power_error, lower * cost.wake_error
        if not used:
            continue
        # what holding costs above brakes is in the power now, or, where that was measured, in the
        # power on brakes
        holding = max(float(np.average(held, weights=time)) - lower, 0.0)
        held_more = holding * (on_brakes if metered else used_time)
        columns = np.concatenate(
            [
                common * (used_time - on_brakes),
                errors,
                [FORM_OF_POSE * held_more, METER * saved if metered else 0.0],
            ]
        )
        others.append(f"{state.name} {watt_hours(saved)}")
        if best is None or saved > best[0]:
            best = saved, columns, state, used
    if best is None:
        return None
    saved, columns, state, used = best
    share = held / lower
    whole = float(time.sum())
    nights = float(time[time >= NIGHT].sum())
    watts = float(np.average(held, weights=time))
    least = break_even(state, float(np.average(share, weights=time)))
    how = "measured" if metered else "predicted"
    return Claim(
        "standby",
        saved,
        columns,
        "assumed" if assumed else how,
        f"drives stay on for {whole / 3600:.3g} h in {len(long)} rests of a minute or more "
        f"({nights / 3600:.3g} h of it in rests of an hour or more), at {watts:.0f} W ({how}); "
        f"{', '.join(others)} saved in the recordings, one instead of the other",
        f"switch to {state.name} in rests longer than {max(least, LONG_REST):.0f} s (pays from "
        f"{least:.0f} s on, {state.wake_time:g} s to wake up); used in {used} rests",
        state=state,
    )


def waiting_pose(evidence: RecordedEvidence, model: RobotModel) -> Claim | None:
    """Return what waiting at the cheapest pose saves in rests too short for standby.

    ``S = sum_rests (P_here - P_cheapest) t``.
    """
    short = [rest for rest in evidence.rests if rest.duration < LONG_REST]
    if not evidence.places or len(short) < 2:
        return None
    place, position = _places(short)
    if len(position) < 2:
        return None
    time = np.bincount(place, [rest.duration for rest in short], len(position))
    chain = _chain(model, evidence)
    use, brakes = chain.rests(position), chain.rests(position, holding=False)
    power, columns, sure = use.energy.copy(), use.columns.copy(), "predicted"
    sums = np.array([(rest.compared_time, rest.measured, rest.predicted) for rest in short])
    compared, measured, predicted = (
        np.bincount(place, sums[:, column], len(position)) for column in range(3)
    )
    shown = compared >= MIN_COMPARED
    holding = np.maximum(power - brakes.energy, 0.0)
    forms = np.diag(FORM_OF_POSE * holding)
    if shown.sum() >= 2:  # only places whose power a meter has shown
        measured, predicted, compared = measured[shown], predicted[shown], compared[shown]
        position, time = position[shown], time[shown]
        power = power[shown] + (measured - predicted) / compared
        sure = "measured"
        columns, forms = np.zeros_like(columns[shown]), np.diag(METER * power)
    best = int(np.argmin(power))
    saved = float(time @ (power - power[best]))
    apart = ((columns - columns[best]) * time[:, None]).sum(axis=0)
    own = ((forms - forms[best]) * time[:, None]).sum(axis=0)
    where = ", ".join(f"{value:.2f}" for value in position[best].tolist())
    return Claim(
        "waiting_pose",
        saved,
        np.concatenate([apart, own]),
        sure,
        f"{time.sum() / 3600:.3g} h of waits shorter than {LONG_REST:.0f} s at {len(position)} "
        f"places, {power[best]:.0f} to {power.max():.0f} W ({sure})",
        f"wait at the joint positions [{where}] where the work allows it",
        joint_position=position[best],
        places=position,
    )


def regenerative(evidence: RecordedEvidence, model: RobotModel) -> Claim | None:
    """Return what a regenerative supply would keep of the energy in the brake resistor.

    ``S = eta E_brake``; arguments as in `waiting_pose`.
    """
    if model.cabinet.regeneration_efficiency is not None or evidence.brake_energy <= 0.0:
        return None
    share, std = REGENERATION
    columns = np.concatenate([share * evidence.brake_columns, [std * evidence.brake_energy]])
    if not evidence.fine:
        columns = np.append(columns, share * FORM_FED_BACK * evidence.brake_energy)
    part = percent(evidence.brake_energy / max(evidence.grid_energy, 1.0))
    return Claim(
        "regenerative",
        share * evidence.brake_energy,
        columns,
        "assumed",
        f"{watt_hours(evidence.brake_energy)} went into the brake resistor, "
        f"{part} of the energy from the grid",
        f"a regenerative supply that returns {percent(share, digits=0)}",
    )


def shared_bus(evidence: RecordedEvidence, model: RobotModel) -> Claim | None:
    """Return what one DC bus for two robots at such work saves, each its half.

    Without capacitors ``S = T/2 (2 E[max(D, 0)] - E[max(D_1 + D_2, 0)])``, with demands D_1, D_2 of
    two robots that both work as recorded and start independently: the share s of what is fed back.
    With them see `_share_saved`. None where a supply is regenerative, or nothing is braked.
    """
    if model.cabinet.regeneration_efficiency is not None or evidence.brake_energy <= 0.0:
        return None
    time, energy = evidence.demand
    seen = time > 0
    if not seen.any():
        return None
    value, share = energy[seen] / time[seen], time[seen] / time[seen].sum()
    fed_back = float(np.maximum(-value, 0.0) @ share)
    braked = min(evidence.brake_energy / evidence.observed_time / fed_back, 1.0)
    parts: list[float] = []
    total, weight = value, share
    for robots in range(2, MOST_ROBOTS + 1):
        total, weight = _sum_of(total, weight, value, share)
        used = 1.0 - float(np.maximum(-total, 0.0) @ weight) / robots / fed_back
        parts.append(_share_saved(used, braked, robots))
    part = parts[0]
    two = part * evidence.brake_energy
    return Claim(
        "shared_bus",
        two,
        np.concatenate([part * evidence.brake_columns, [FORM_OF_STARTS * two]]),
        "predicted",
        f"{watt_hours(evidence.brake_energy)} went into the brake resistor; with two "
        f"robots at such work on one DC bus {percent(part)} of it would be used, with "
        f"{MOST_ROBOTS} robots {percent(parts[-1])}, where starts fall anywhere",
        "one DC bus for robots that stand together; `robot-energy shared-bus` computes it for "
        "recordings made at one time, and `optimize --level --one-bus` shifts starts",
    )


def _share_saved(used: float, braked: float, robots: int) -> float:
    """Return the share of the braked energy that one bus saves. [-]

    A capacitor of energy E leaves ``B = m exp(-E/m)`` of braking whose energies are exponential, m
    in the mean. On one bus the others use s of it, and their capacitors are free in half of the
    time: ``B' = (1 - s) m exp(-E (R + 1) / 2 / (m (1 - s)))``, saved is ``1 - B'/B``.

    Args:
        used: s, what other robots use of what is fed back. [-]
        braked: B/m, 1 without a capacitor. [-]
        robots: R, on one bus.
    """
    left = 1.0 - used
    return 1.0 - left * braked ** (0.5 * (robots + 1) / left - 1.0) if left > 0.0 else 1.0


def _sum_of(value: Float, share: Float, other: Float, of_other: Float) -> tuple[Float, Float]:
    """Values and shares of the sum of two independent demands, in `DEMAND_BINS` again."""
    total, weight = np.add.outer(value, other).ravel(), np.multiply.outer(share, of_other).ravel()
    total = np.clip(total, DEMAND_BINS[0], DEMAND_BINS[-1])
    time = np.histogram(total, DEMAND_BINS, weights=weight)[0]
    energy = np.histogram(total, DEMAND_BINS, weights=weight * total)[0]
    seen = time > 0
    return energy[seen] / time[seen], time[seen]


def warm_up(evidence: RecordedEvidence, model: RobotModel, replay: str = "") -> Claim | None:
    """Return what friction at the temperature of the warm robot saves.

    ``S = sum_joints integral (fv(T) - fv(T_warm)) w^2 dt`` over motion fed from the grid, less what
    the warmer windings and weaker magnets lose, ``integral dP_loss/dT (T_warm - T) dt``, 1.5 of it
    for a joint without ``torque_constant_fall``. A fan that warmth starts is in the band alone.
    """
    time = evidence.motion_time.sum(axis=1)
    if not evidence.measured_temperature or not (time > 0).all():
        return None
    middle = DEGC_MIDDLES
    done = np.cumsum(evidence.motion_time, axis=1) / time[:, None]
    warm = middle[np.argmax(done >= WARM, axis=1)]
    mean: Float = (evidence.motion_time * middle).sum(axis=1) / time
    if float(np.max(warm - mean)) < MIN_WARMING:
        return None
    friction, certainty = FrictionModel.from_model(model), FrictionCertainty(model)
    grid = np.broadcast_to(middle[:, None], (len(middle), len(warm)))
    colder = np.minimum(grid, warm)
    saved = (friction.viscous(colder) - friction.viscous(warm)).T * evidence.squared_speed
    at = np.hypot(certainty.std(colder)[0], certainty.std(warm[None, :])[0]) * (grid < warm)
    joints = saved.sum(axis=1)
    own = (at.T * evidence.squared_speed).sum(axis=1)
    risen: Float = np.maximum(warm[:, None] - middle, 0.0)
    magnets = [1.0 if joint.torque_constant_fall else MAGNETS for joint in model.joints]
    lost = float(np.array(magnets) @ (evidence.warm_loss * risen).sum(axis=1))
    standing = FORM_OF_STANDING * model.constant_power() * evidence.observed_time
    degc = float(np.mean(warm))
    return Claim(
        "warm_up",
        float(joints.sum()) - lost,
        np.concatenate([own, [FORM_OF_WARMING * joints.sum(), FORM_OF_COPPER * lost, standing]]),
        "predicted",
        f"motors were at {mean.mean():.0f} degC on average in motion and at {degc:.0f} "
        "degC once warm; the difference of friction, less what warm windings lose more; what "
        "warming up costs is not in it",
        f"start at {degc:.0f} degC: jobs without long breaks between them, a warmer place, and no "
        "cold start for a few cycles",
        replay and f"{replay} --compare {degc:.0f}",
        motor_temperature_degc=warm,
    )


def _chain(model: RobotModel, evidence: RecordedEvidence) -> PowerChain:
    """At the mean temperature of motion, else the fallback."""
    degc = np.full(len(model.joints), model.temperature.fallback_degc)
    if evidence.motion_time.sum() > 0 and len(evidence.motion_time) == len(degc):
        time = evidence.motion_time.sum(axis=1)
        mean = (evidence.motion_time * DEGC_MIDDLES).sum(axis=1) / np.maximum(time, 1e-9)
        degc = np.where(time > 0, mean, degc)
    return PowerChain(model, degc[None, :])


def _places(rests: Sequence[RecordedRest]) -> tuple[Int, Float]:
    """Place of each rest, shape (R,), and joint positions there, shape (P, n)."""
    positions: list[Float] = []
    place: list[int] = []
    for rest in rests:
        near = [
            number
            for number, one in enumerate(positions)
            if float(np.abs(one - rest.joint_position).max()) <= SAME_PLACE
        ]
        if not near:
            positions.append(rest.joint_position)
        place.append(near[0] if near else len(positions) - 1)
    return np.array(place, dtype=np.int64), np.array(positions)


def of_all(
    claims: Sequence[Claim | None], time: Sequence[float], whole: float, bags: int
) -> Claim | None:
    """Return what a change saves in all bags, from what it saves in some.

    ``S = T sum_i S_i / sum_i t_i``. Errors of the model are common to the bags, so their standard
    deviations add up; the spread between the bags is that of a ratio of n of N bags,
    ``T^2 (1 - n/N) n/(n - 1) sum_i (S_i - r t_i)^2 / (sum_i t_i)^2`` with ``r = S / T``.

    Args:
        time: Predicted of each bag. [s]
        whole: Predicted of all. [s]

    Returns:
        The claim; None where no bag has one, or only one or two of more were looked at.
    """
    found = [one for one in claims if one is not None]
    count = len(claims)
    if not found or count < min(MIN_BAGS, bags):
        return None
    saved = np.array([0.0 if one is None else one.energy for one in claims])
    taken = np.asarray(time)
    scale = whole / float(taken.sum())
    rate = float(saved.sum() / taken.sum())
    spread = 0.0
    if count < bags:
        variance = (1.0 - count / bags) * count / (count - 1) * ((saved - rate * taken) ** 2).sum()
        spread = scale * np.sqrt(variance) * STUDENT[count] / Z90
    common = scale * sum(one.half for one in found) / Z90
    most = max(found, key=lambda one: one.energy)
    return replace(
        most,
        energy=scale * float(saved.sum()),
        columns=np.array([common, spread]),
        found=f"in {len(found)} of {count} analysed bags, of {bags} in all; where it saves most: "
        f"{most.found}",
    )
