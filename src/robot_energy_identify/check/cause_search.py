"""Which causes explain the torque of a recording, and what it cannot show.

For every cause the recording is corrected as if it were there, and fitted again with all that the
figures of the model leave open (`robot_energy_identify.check.torque_fit`). The likeliest cause is
named if it is far likelier than no cause, and than any other; then the search goes on with the
corrected recording. Where another explains as much, or bodies that are further off than their
priors say, both are named and none is blamed. What would change too little to be named cannot be
judged from the recording.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from robot_energy_identify.check.evidence import Evidence
from robot_energy_identify.check.payload import more_payload
from robot_energy_identify.check.possible_causes import (
    FREE,
    Cause,
    candidates,
    fit_without,
    worth_a_fit,
    zero_offset,
)
from robot_energy_identify.check.torque_fit import TorqueFit

MAX_CAUSES = 4  # found one after the other
NEEDED = 12.0  # of cost, that a cause must gain to be named
ALIKE = 6.0  # of cost: two causes that differ by less cannot be distinguished
FURTHER = 5.0  # times their priors, that the bodies of one link may be off; of all, half of it
RARE = 6.0  # of cost, that this must gain before it counts
CLEAR = 60.0  # of cost, beyond which it is not tried whether bodies explain a mistake
MAX_SURPRISE = 6.0  # of the errors that remain, from which a recording is not mended
OFFSET = 0.1  # rad: the least zero error that is to be found
UNITS = {"gear_ratio": (2.0, 0.5), "torque_scale": (2.0**0.5, 2.0**-0.5)}  # least to be found
MIN_MASS = 0.3  # kg: the least payload that is to be found


@dataclass(frozen=True)
class Found:
    """A cause, or several of which each explains the recording.

    Attributes:
        cause: The likeliest.
        links: Whose bodies explain it as well, if they are further off than their priors.
        alternatives: Other causes that do.
        fit: Of the recording with it.
    """

    cause: Cause
    links: tuple[int, ...]
    alternatives: tuple[Cause, ...]
    fit: TorqueFit


@dataclass(frozen=True)
class SearchResult:
    """Causes of a recording, and what it cannot show.

    Attributes:
        found: The strongest first.
        last: The recording without the causes.
        unseen: Causes that change too little to be named if they were there.
        payload: The least mass that would be found; infinite for none. [kg]
    """

    found: tuple[Found, ...]
    last: TorqueFit
    unseen: tuple[Cause, ...]
    payload: float


def search(fit: TorqueFit) -> SearchResult:
    """Return the causes, the strongest first, and what cannot be seen."""
    found: list[Found] = []
    while True:
        likely = [cause for cause in candidates(fit) if worth_a_fit(cause, fit)]
        tried = [(cause, fit_without(cause, fit)) for cause in likely]
        worst = max(MAX_SURPRISE, fit.errors.surprise)  # what needs worse bodies mends nothing
        costs = [
            corrected.cost + FREE * cause.free if corrected.errors.surprise <= worst else np.inf
            for cause, corrected in tried
        ]
        place = int(np.argmin(costs)) if costs else 0
        if not costs or fit.cost - costs[place] < NEEDED or len(found) == MAX_CAUSES:
            break
        cause, corrected = tried[place]
        alternatives = [
            other
            for (other, _), cost in zip(tried, costs, strict=True)
            if cost - costs[place] < ALIKE and not _same(other, cause)
        ]
        links = _links_alike(fit, costs[place] + ALIKE)
        found.append(Found(cause, links, tuple(alternatives), fit))
        if alternatives or links:
            break
        fit = corrected
    return SearchResult(tuple(found), fit, tuple(_unseen_causes(fit, tried)), _least_payload(fit))


def _least_payload(fit: TorqueFit) -> float:
    """The least mass that would be found, as the cost rises with its square. [kg]"""
    robot = fit.evidence.robot
    mass = 0.05 * robot.moving_mass
    heavier = replace(fit.evidence, robot=robot.with_payload(more_payload(fit.evidence, mass)))
    rise = TorqueFit(heavier).cost - fit.cost
    return (
        max(MIN_MASS, mass * float(np.sqrt((NEEDED + 2 * FREE) / rise))) if rise > 1.0 else np.inf
    )


def _same(one: Cause, other: Cause) -> bool:
    """Whether two causes are one, of sizes within their deviations."""
    if one.name != other.name or one.joints != other.joints:
        return False
    spread = float(np.nan_to_num(np.hypot(one.std, other.std)))
    return abs(one.value - other.value) <= 3.0 * spread


def _links_alike(fit: TorqueFit, cost: float) -> tuple[int, ...]:
    """Links whose bodies, if they are further off than their priors, explain as much."""
    every = tuple(range(len(fit.known)))
    alone = [k for k in every if fit.widened(FURTHER, (k,)).cost + RARE < cost]
    if alone:
        return tuple(alone)
    return every if fit.widened(FURTHER / 2, every).cost + RARE < cost else ()


def _unseen_causes(fit: TorqueFit, tried: list[tuple[Cause, TorqueFit]]) -> list[Cause]:
    """Causes that raise the cost by less than they must lower it to be named.

    A recording with the mistake differs from one without it as the two differ here.
    """

    def hidden(cause: Cause, corrected: TorqueFit) -> bool:
        rise = corrected.cost - fit.cost - FREE * cause.free
        return rise < NEEDED or (rise < CLEAR and bool(_links_alike(corrected, fit.cost + ALIKE)))

    unseen = [
        cause
        for cause, corrected in tried
        if cause.name not in ("zero_offset", "effort_meaning", "payload")
        and not any(abs(cause.value) == skipped for skipped in (10.0, 0.1, 100.0, 0.01))
        and (cause.name not in UNITS or cause.value in UNITS[cause.name])
        and hidden(cause, corrected)
    ]
    for j in np.flatnonzero(~np.asarray(fit.evidence.robot.limits.prismatic)).tolist():
        shifted = [zero_offset((j,), value, OFFSET) for value in (OFFSET, -OFFSET)]
        if any(hidden(one, fit_without(one, fit)) for one in shifted):
            unseen.append(shifted[0])
    return unseen


def contradicts(part: Evidence, cause: Cause) -> bool:
    """Return whether a recording becomes less likely without a cause.

    Args:
        part: Thinned.
    """
    fit = TorqueFit(part)
    return fit_without(cause, fit).cost > fit.cost + ALIKE
