"""Planar arms: revolute joints with parallel axes, in the complex plane across them.

The tool is at ``z = z0 + sum over i of l_i exp(j theta_i)`` with ``theta_i = sum over k <= i of
s_k q_k``: `l_i` are the links at zero joint positions, ``s_k`` the senses of the axes. Two free
joints have a closed form, which a stretched start or a hole in the reach does not hinder; with
more, the configuration nearest to a reference is wanted, ``min 1/2 sum w (q - q_ref)^2`` with the
tool in place (paper B, section 4.1, leaves the choice open). That one is a function of the tool
position alone, so a closed tool path is a closed joint path, which steps along a weighted
pseudo-inverse would not give.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.described import Described
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import Float

Complex = NDArray[np.complexfloating]

PARALLEL = 1e-9  # sine of the angle between axes that count as parallel
POSITION_TOLERANCE = 1e-12  # m: the tool is in place
SLOPE_TOLERANCE = 1e-10  # slope of the objective along the redundant motion, per its weight [rad]
STRETCHED = 1e-4  # sine of the angle between two links that count as one line
STRIDES = (0.2, 0.05)  # m of tool way from one solution to the next; the second where one fails
AHEAD = 128  # places from one that is followed along the path to the next; all between at once
MAX_STEPS = 50
MAX_STEP = 0.3  # rad


class PlanarArm(Described):
    """Geometry of a planar arm."""

    origin: Annotated[Float, "Place of the first joint, in the base frame, shape (3,). [m]"]
    across: Annotated[Float, "Two unit vectors that span the plane, shape (2, 3)."]
    height: Annotated[float, "Height of the tool along the axes, above the first joint. [m]"]
    normal: Annotated[Float, "Unit vector along the axes, shape (3,)."]
    sense: Annotated[Float, "+1 or -1 per joint, shape (n,)."]
    link: Annotated[Complex, "From joint to joint and to the tool, at zero, shape (n,). [m]"]

    @classmethod
    def of_robot(cls, robot: Robot, link: str) -> PlanarArm | None:
        """Return the geometry of a robot; None if it is not a planar arm."""
        zero = np.zeros(robot.n_joints)
        tool, _, jacobian = robot.link_jacobian(zero, link)
        axes: Float = jacobian[3:].T
        if robot.limits.prismatic.any() or robot.n_joints < 2:
            return None
        normal = np.array(axes[0])
        along = axes @ normal
        if np.abs(axes - np.outer(along, normal)).max() > PARALLEL:
            return None
        first = np.eye(3)[int(np.argmin(np.abs(normal)))]
        first = first - (first @ normal) * normal
        first /= np.linalg.norm(first)
        across = np.stack([first, np.cross(normal, first)])
        origins = robot.joint_origins(zero)
        places = (np.vstack([origins, tool]) - origins[0]) @ across.T
        steps = np.diff(places[:, 0] + 1j * places[:, 1])
        sense = np.sign(along)
        return cls(
            origins[0], across, float((tool - origins[0]) @ normal), normal, sense, np.array(steps)
        )

    def split(self, tool_position: Float) -> tuple[Complex, Float]:
        """Return places in the plane and heights above the tool's own, shape (N,) each. [m]

        Args:
            tool_position: In the base frame, shape (N, 3). [m]
        """
        away = tool_position - self.origin
        plane = away @ self.across.T
        return plane[:, 0] + 1j * plane[:, 1], away @ self.normal - self.height

    def reach(self, joint_position: Float, free: Sequence[int]) -> tuple[complex, float, float]:
        """Return the place of the first free joint, least and greatest distance from it. [m]

        Args:
            joint_position: Positions of the others, shape (n,). [rad]
        """
        start, links = self._chain(joint_position, free)
        size = np.abs(links)
        total = float(size.sum())
        return start, max(0.0, 2.0 * float(size.max()) - total), total

    def _chain(self, joint_position: Float, free: Sequence[int]) -> tuple[complex, Complex]:
        """The arm with every held joint merged with its neighbours.

        That is the place of the first free joint, and the links from free joint to free joint, the
        last to the tool, with the free joints at zero. [m]
        """
        held = joint_position.copy()
        held[list(free)] = 0.0
        vectors = self.link * np.exp(1j * np.cumsum(held * self.sense))
        edges = [0, *free, len(vectors)]
        start = complex(vectors[: edges[1]].sum())
        parts = [vectors[a:b].sum() for a, b in pairwise(edges[1:])]
        return start, np.array(parts)

    def two_free(self, place: Complex, start: Float, free: Sequence[int]) -> Float:
        """Return the closed form for two free joints on the side of the start, shape (N, n). [rad]

        It is nan where both links lie in one line.

        Args:
            place: Places of the tool, within reach, shape (N,). [m]
            start: Joint positions before the first place; decides the side, shape (n,). [rad]
        """
        origin, (inner, outer) = self._chain(start, free)
        a, b = free
        bend = np.angle(outer) - np.angle(inner)
        side = np.sin(self.sense[b] * start[b] + bend)
        way = place - origin
        size = abs(inner) * abs(outer)
        cosine = (np.abs(way) ** 2 - abs(inner) ** 2 - abs(outer) ** 2) / (2.0 * size)
        sine = np.sqrt(np.maximum(1.0 - cosine**2, 0.0)) * (-1.0 if side < 0 else 1.0)
        second = np.arctan2(sine, cosine) - bend
        first = np.angle(way) - np.angle(inner + outer * np.exp(1j * second))
        result = np.tile(start, (len(place), 1))
        for joint, angle in ((a, first), (b, second)):
            turned = np.concatenate([start[joint : joint + 1], angle * self.sense[joint]])
            result[:, joint] = np.unwrap(turned)[1:]
        result[np.abs(sine) < STRETCHED] = np.nan
        return result

    def nearest(self, place: Complex, start: Float, free: Sequence[int], weight: Float) -> Float:
        """Return configurations nearest to the start, tool in place, shape (N, n). [rad]

        They are found along the path; nan from the first place that was not found.

        Args:
            place: Places of the tool, shape (N,). [m]
            start: The reference, shape (n,). [rad]
            weight: Weight of each joint's way from the reference, > 0, shape (n,). [-]
        """
        result = np.full((len(place), len(start)), np.nan)
        posture, force = start, np.zeros(2)
        before = complex(self._arms(start[None])[0, 0])
        ends = [0, *range(AHEAD, len(place) - 1, AHEAD), len(place) - 1][: len(place)]
        last = -1
        for end in ends:
            rows = np.arange(last + 1, end + 1)
            found = self._along(before, complex(place[end]), posture, force, start, free, weight)
            if found is not None:  # those between are near the way from one to the other
                share = ((rows - last) / (end - last))[:, None]
                guess = posture + share * (found[0] - posture)
                pull = force + share * (found[1] - force)
                between, _, done = self._nearest(place[rows], guess, pull, start, free, weight)
                near = np.abs(between - guess).max(axis=1) < MAX_STEP
                if (done & near).all():
                    result[rows] = between
                    posture, force = found
                    last, before = end, complex(place[end])
                    continue
            for row in rows.tolist():
                wanted = complex(place[row])
                found = self._along(before, wanted, posture, force, start, free, weight)
                if found is None:
                    return result
                posture, force = found
                result[row], before = posture, wanted
            last = end
        return result

    def _arms(self, joint_position: Float) -> Complex:
        """From each joint to the tool, shape (N, n). [m]"""
        vectors = self.link * np.exp(1j * np.cumsum(joint_position * self.sense, axis=1))
        return np.cumsum(vectors[:, ::-1], axis=1)[:, ::-1]

    def _along(
        self, before: complex, wanted: complex, posture: Float, force: Float,
        start: Float, free: Sequence[int], weight: Float,
    ) -> tuple[Float, Float] | None:  # fmt: skip
        """Posture and force at the end of a straight way of the tool; None if not found."""
        for stride in STRIDES:
            count = max(1, int(np.ceil(abs(wanted - before) / stride)))
            now, pull = posture[None], force[None]
            for share in np.linspace(0.0, 1.0, count + 1)[1:]:
                goal, last = np.array([before + share * (wanted - before)]), now
                now, pull, done = self._nearest(goal, now, pull, start, free, weight)
                far = stride > STRIDES[-1] and (np.abs(now - last) > MAX_STEP).any()
                if far or not done[0]:  # a long stride may have found another posture
                    break
            else:
                return now[0], pull[0]
        return None

    def _nearest(
        self,
        place: Complex,
        posture: Float,
        force: Float,
        start: Float,
        free: Sequence[int],
        weight: Float,
    ) -> tuple[Float, Float, NDArray[np.bool_]]:
        """Newton's method for tools in place and the objective level along the rest.

        Returns:
            Postures (N, n), forces (N, 2), and which were found (N,).
        """
        index = np.asarray(free)
        count = len(index)
        later = np.maximum.outer(np.arange(count), np.arange(count))
        signs = np.outer(self.sense[index], self.sense[index])
        posture, force = posture.copy(), force.copy()
        done = np.zeros(len(place), dtype=np.bool_)
        for _ in range(MAX_STEPS):
            rows = np.flatnonzero(~done)
            now, pulled = posture[rows], force[rows]
            arms = self._arms(now)
            slope = 1j * self.sense[index] * arms[:, index]
            jacobian = np.stack([slope.real, slope.imag], axis=1)
            away = arms[:, 0] - place[rows]
            pull = weight[index] * (now - start)[:, index]
            pull -= np.einsum("ni,nik->nk", pulled, jacobian)
            level = np.abs(pull / weight[index]).max(axis=1) < SLOPE_TOLERANCE
            level &= np.abs(away) < POSITION_TOLERANCE
            done[rows[level]] = True
            if level.all():
                break
            rows, pulled, jacobian = rows[~level], pulled[~level], jacobian[~level]
            pull, away, arms = pull[~level], away[~level], arms[~level]
            bent = -signs * arms[:, index][:, later]  # second derivatives of the place
            matrix = np.zeros((len(rows), count + 2, count + 2))
            matrix[:, :count, :count] = -(
                pulled[:, 0, None, None] * bent.real + pulled[:, 1, None, None] * bent.imag
            )
            matrix[:, range(count), range(count)] += weight[index]
            matrix[:, :count, count:] = -jacobian.swapaxes(1, 2)
            matrix[:, count:, :count] = jacobian
            rest = -np.column_stack([pull, away.real, away.imag])
            try:
                step = np.linalg.solve(matrix, rest[..., None])[..., 0]
            except np.linalg.LinAlgError:
                break
            size = np.abs(step[:, :count]).max(axis=1)
            share = np.minimum(1.0, MAX_STEP / np.maximum(size, MAX_STEP))[:, None]
            posture[rows[:, None], index] += share * step[:, :count]
            force[rows] += share * step[:, count:]
        return posture, force, done
