"""Fit in which every link is a body that can exist, near what is known of it.

A link's pseudo-inertia ``J = [[S, m c], [m c', m]]``, S the second moments of its mass,
must be positive definite: mass above 0, inertias that obey the triangle inequality
(Wensing, Kim and Slotine, Linear matrix inequalities for physically consistent inertial
parameter identification, 2018). What the data cannot determine follows the prior, here the URDF.

The rows enter as a triangle (R, b), so the size of the problem does not grow with the
recording. The cone program goes to Clarabel as it is; it is small enough to be written
down directly.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.foundation.extras import require
from robot_energy.timeline.blocks import Float
from robot_energy_identify.stats.regression import qr_r

ROOT2 = float(np.sqrt(2.0))
MIN_MASS = 1e-3  # of a link, kg: below, a body has no meaning
MIN_RADIUS = 0.01  # m: a smaller body than this is not drawn from the prior
MARGIN = 1e-6  # share of the prior that keeps a pseudo-inertia off the boundary


class Prior(Described):
    """What is known before the fit."""

    values: Annotated[Float, "Shape (P,), links first."]
    std: Annotated[Float, "How far off they may be, shape (P,); inf: nothing is known."]


def link_prior(link_parameters: Float, uncertainty: float) -> Prior:
    """Return the links of a URDF as a prior, each uncertain in proportion to its size.

    Args:
        link_parameters: Ten per link, shape (10 n,). [kg], [kg m] and [kg m^2]
        uncertainty: One standard deviation as a share: of the mass, of mass times radius
            of gyration, of mass times its square. [-]
    """
    values = link_parameters.copy()
    std = np.empty_like(values)
    for start in range(0, len(values), 10):
        link = values[start : start + 10]
        mass = max(float(link[0]), MIN_MASS)
        spread = float(np.trace(second_moments(link))) / mass
        radius = max(float(np.sqrt(max(spread, 0.0))), MIN_RADIUS)
        std[start] = mass
        std[start + 1 : start + 4] = mass * radius
        std[start + 4 : start + 10] = mass * radius**2
    return Prior(values, uncertainty * std)


def second_moments(link: Float) -> Float:
    """Return S, the second moments of a link's mass about its joint, shape (3, 3). [kg m^2]

    Args:
        link: m, m c, Ixx, Ixy, Iyy, Ixz, Iyz, Izz, shape (10,). [kg] to [kg m^2]
    """
    inertia, places = np.empty((3, 3)), np.tril_indices(3)  # Ixx Ixy Iyy Ixz Iyz Izz
    inertia[places] = inertia.T[places] = link[4:10]
    return 0.5 * float(np.trace(inertia)) * np.eye(3) - inertia


def pseudo_inertia(link: Float) -> Float:
    """Return J of one link, shape (4, 4); positive definite for a body that can exist.

    Args:
        link: m, m c, Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the joint, shape (10,).
            [kg], [kg m] and [kg m^2]
    """
    result = np.empty((4, 4))
    result[:3, :3] = second_moments(link)
    result[:3, 3] = result[3, :3] = link[1:4]
    result[3, 3] = link[0]
    return result


def consistent_fit(
    triangle: Float, target: Float, prior: Prior, n_links: int, positive: Sequence[int]
) -> Float:
    """Return bodies that can exist, (P,), of least ``|R x - b|^2 + |(x - prior) / std|^2``.

    Args:
        triangle: R, rows in standard deviations of their noise, shape (K, P). [1/parameter]
        target: b, shape (K,). [-]
        positive: Parameters that must not be negative (friction, rotor inertia).
    """
    require("clarabel", "a fit of bodies that can exist")
    import clarabel
    from scipy import sparse

    size = len(prior.values)
    known = np.isfinite(prior.std)
    column = np.linalg.norm(triangle, axis=0)
    scale = np.where(known, prior.std, 1.0 / np.where(column > 0.0, column, 1.0))
    scaled = triangle * scale
    # |R s y - b|^2 + |y - y0|^2 over the known ones, with x = s y. About its least value the
    # objective is |T (y - least)|^2; in w = T (y - least) / reach it is a sphere of about
    # unit size, however much better the data know one direction than the prior another.
    pull = np.diag(np.where(known, 1.0, 1e-6))
    origin = np.where(known, prior.values / scale, 0.0)
    both = np.concatenate([scaled, pull])
    whole = qr_r(np.column_stack([both, np.concatenate([target, origin])]))
    stretch = whole[:size, :size]
    least = np.linalg.solve(stretch, whole[:size, size])
    reach = max(float(np.linalg.norm(stretch @ (origin - least))), 1e-3)
    rows, offsets, cones = _cones(prior.values, scale, n_links, positive, size)
    spread = np.linalg.solve(stretch.T, rows.T).T * reach
    settings: Any = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix(np.eye(size)),
        np.zeros(size),
        sparse.csc_matrix(spread),
        offsets - rows @ least,
        cones,
        settings,
    )
    solution = solver.solve()
    if str(solution.status) not in ("Solved", "AlmostSolved"):
        raise NotIdentifiableError(
            f"no physically consistent fit was found ({solution.status})",
            "a URDF whose links are bodies that can exist, near the robot's",
            "check units, gear ratios and zero offsets",
        )
    return (least + np.linalg.solve(stretch, reach * np.asarray(solution.x))) * scale


def _cones(
    values: Float, scale: Float, n_links: int, positive: Sequence[int], size: int
) -> tuple[Float, Float, list[Any]]:
    """Rows A and offsets b of ``b - A y in cone``."""
    import clarabel

    # the scales are positive
    blocks: list[Float] = [-np.eye(size)[list(positive)]]
    offsets: list[Float] = [np.zeros(len(positive))]
    cones: list[Any] = [clarabel.NonnegativeConeT(len(positive))]
    basis = np.stack([_upper(pseudo_inertia(unit)) for unit in np.eye(10)], axis=1)
    for link in range(n_links):
        columns = slice(10 * link, 10 * link + 10)
        mass = max(float(values[10 * link]), MIN_MASS)
        spread = float(scale[10 * link + 4] / scale[10 * link])
        # Unit-free: J scaled by mass and radius, so that all entries are about 1.
        shape = np.array([spread, spread, spread, 1.0]) ** 0.5 * mass**0.5
        weight = _upper(1.0 / np.outer(shape, shape), off_diagonal=1.0)
        block = np.zeros((10, size))
        block[:, columns] = -(weight[:, None] * basis) * scale[columns]
        blocks.append(block)
        offsets.append(-_upper(MARGIN * np.eye(4)))
        cones.append(clarabel.PSDTriangleConeT(4))
    return np.concatenate(blocks), np.concatenate(offsets), cones


def _upper(matrix: Float, off_diagonal: float = ROOT2) -> Float:
    """Upper triangle of a symmetric matrix column by column, off-diagonal entries times root 2."""
    row, column = np.tril_indices(len(matrix))
    weight: Float = np.where(row == column, 1.0, off_diagonal)
    return matrix[row, column] * weight
