"""Which robots differ from their sisters, at equal temperature and work.

A figure of every bag, such as the logarithm of the friction of a joint, is

``y = u[robot] + z . b + e``,

with what bags differ in, z: shares of temperature and speed. b comes from the differences between
the bags of the same robot alone, so a robot that always runs warm is not taken for a bad one. Of
the levels u one is drawn aside after the other, the farthest first, and compared with the others:

``t = (u_i - mean of the others) / sqrt(tau^2 + se_i^2 + s^2 / m)``,

where s is the standard deviation of the m others, se the standard error of a level, and
``tau^2 = s^2 - median(se^2)`` how much sound sisters differ. Without faults t has Student's
distribution of m - 1 degrees. The largest number of robots set aside at which the last one is
still beyond the limit is the number of those that differ (generalised extreme Studentised deviate
test, B. Rosner, Technometrics 25 (1983) 165), so that several faults do not hide each other.
All limits are divided by the number of comparisons.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from robot_energy.certainty.deviation import MEDIAN_TO_STD
from robot_energy.foundation.described import Described
from robot_energy.timeline.blocks import Float, Int

MIN_SISTERS = 5  # robots with a figure, below which none is compared
MIN_BAGS = 3  # of a robot with a figure
MAX_SHARE = 0.3  # of the robots that may differ from the others
MAX_FALSE = 0.01  # probability of anything false in a whole report
HUBER = 2.0  # standard deviations, beyond which a bag weighs less
ROUNDS = 12
TINY = 1e-12  # against a division by 0
PRIOR_BAGS = 5.0  # that the usual scatter of a bag counts for, in addition to a robot's own
RIDGE = 1e-3  # of one bag, on every coefficient: a share that does not vary has none


class Levels(Described):
    """Levels of the robots at the mean of what bags differ in."""

    level: Annotated[Float, "NaN for a robot with too few bags, shape (R,). [unit of the figure]"]
    std: Annotated[Float, "Standard error, shape (R,)."]
    bags: Annotated[Int, "Bags behind each, shape (R,)."]
    rest: Annotated[Float, "Of each bag, its figure without ``z . b``, shape (B,)."]


class Deviation(Described):
    """A robot that differs from its sisters."""

    robot: int
    size: Annotated[float, "Its level minus the mean of the sound ones. [unit of the figure]"]
    std: Annotated[float, "Standard deviation, by the scatter of bags and sound sisters."]
    certainty: Annotated[float, "Probability that it is not chance, of all comparisons. [-]"]


def levels(figure: Float, robot: Int, work: Float, counted: np.ndarray) -> Levels:
    """Return the levels at equal work, one for each robot number up to the largest.

    Args:
        figure: Of each bag; NaN where unknown, shape (B,). [any unit]
        robot: Number of each bag's robot, shape (B,).
        work: What bags differ in, shape (B, K). [-]
        counted: Which bags count for the level, such as the newest, shape (B,).
    """
    known = np.isfinite(figure) & np.isfinite(work).all(axis=1)
    robots = int(robot.max()) + 1 if len(robot) else 0
    y, number = figure[known], robot[known]
    z = work[known] - work[known].mean(axis=0) if known.any() else work[known]
    weight = np.ones(len(y))
    slope = np.zeros(z.shape[1])
    for _ in range(ROUNDS):
        total = np.maximum(np.bincount(number, weight, robots), 1e-12)

        def inside(values: Float, total: Float = total, weight: Float = weight) -> Float:
            mean = np.bincount(number, weight * values, robots) / total
            return values - mean[number]

        own = np.column_stack([inside(column) for column in z.T]) if z.shape[1] else z
        normal = (own * weight[:, None]).T @ own + RIDGE * np.eye(z.shape[1])
        slope = np.linalg.solve(normal, (own * weight[:, None]).T @ inside(y))
        off = np.abs(inside(y - z @ slope))
        scale = MEDIAN_TO_STD * float(np.median(off)) + TINY if len(off) else 1.0
        weight = np.minimum(1.0, HUBER * scale / np.maximum(off, 1e-12))
    rest = np.full(len(figure), np.nan)
    rest[known] = y - z @ slope
    level = np.full(robots, np.nan)
    used = known & counted
    bags = np.bincount(robot[used], minlength=robots)
    scatter = np.full(robots, np.nan)
    for one in np.flatnonzero(bags >= MIN_BAGS).tolist():
        values = rest[used & (robot == one)]
        level[one] = np.median(values)
        scatter[one] = MEDIAN_TO_STD * float(np.median(np.abs(values - level[one])))
    usual = float(np.nanmedian(scatter)) if np.isfinite(scatter).any() else 0.0
    own = (bags * scatter**2 + PRIOR_BAGS * usual**2) / (bags + PRIOR_BAGS)
    # of a median of normal values: pi / 2 times the variance of their mean
    std = np.sqrt(own * 0.5 * np.pi / np.maximum(bags, 1))
    return Levels(level, std, bags, rest)


def stand_out(level: Float, std: Float, comparisons: int) -> list[Deviation]:
    """Return the robots that differ from the others, the farthest first; empty for too few.

    Args:
        level: NaN for a robot that is not compared, shape (R,). [any unit]
        std: Standard errors, shape (R,). [as the level]
    """
    from scipy.special import stdtr

    known = np.flatnonzero(np.isfinite(level))
    if len(known) < MIN_SISTERS:
        return []
    left: list[int] = known.tolist()
    aside, found = list[int](), 0
    for _ in range(max(1, int(MAX_SHARE * len(known)))):
        if len(left) < MIN_SISTERS:
            break
        scores: list[float] = np.abs(_scores(level[left], std[left])).tolist()
        worst = scores.index(max(scores))
        chance = 2.0 * float(stdtr(len(left) - 2, -max(scores))) * len(left) * comparisons
        aside.append(left.pop(worst))
        if chance < MAX_FALSE:
            found = len(aside)
    sound = np.setdiff1d(known, aside[:found])
    result: list[Deviation] = []
    for one in aside[:found]:
        size = float(level[one] - level[sound].mean())
        variance = float(level[sound].var(ddof=1))
        between = max(variance - float(np.median(std[sound] ** 2)), 0.0)
        spread = float(np.sqrt(between + std[one] ** 2 + variance / len(sound))) + TINY
        chance = 2.0 * float(stdtr(len(sound) - 1, -abs(size) / spread)) * len(known) * comparisons
        result.append(Deviation(one, size, spread, max(0.0, 1.0 - chance)))
    return result


def _scores(level: Float, std: Float) -> Float:
    """Deviation of every robot from the mean of the others, over its standard deviation."""
    count = len(level) - 1
    centred = level - level.mean()
    mean = -centred / count  # of the others
    square = float(centred @ centred) - centred**2
    variance = np.maximum(square - count * mean**2, 0.0) / (count - 1)
    between = np.maximum(variance - float(np.median(std**2)), 0.0)
    return (centred - mean) / (np.sqrt(between + std**2 + variance / count) + TINY)
