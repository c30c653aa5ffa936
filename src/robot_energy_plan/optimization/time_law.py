"""The cheapest time law along a given path, as a cone program.

Variables at the places of a path with its own time ``p``: the speed ``y = dp/dt``, its square
``b >= y^2``, the time ``u >= 1/y`` per path time, the copper loss ``z >= k tau^2 / y`` of each
drive and the energy ``e`` from the bus of each part, never negative, as the brake resistor gives
nothing back. The energy of a part is the integral of ``tau w dt``, and ``tau w0`` is linear in
``b`` and ``a``; so is all else but for the cones. Speed, acceleration, torque and jerk of every
joint are limited. The method is that of Verscheure et al. (IEEE TAC 54, 2009), with the energy of
a drive as objective; the solver is Clarabel. ``b >= y^2`` need not hold with equality in the
solution; the law is ``sqrt(b)``, and its energy and limits are computed again from the motion.

The path is a motion ``q(p)`` over its own time ``p``; run at ``y = dp/dt`` its joints have the
velocity ``q' y`` and the acceleration ``q'' y^2 + q' a`` with ``a = d(y^2)/dp / 2``. So the rigid
motor torque is linear in ``b = y^2`` and ``a``, and with friction ``fc sgn(w) + fv w`` the torque
is linear in ``b``, ``a`` and ``y``.
"""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.extras import require
from robot_energy.timeline.blocks import Float
from robot_energy_plan.motion.ptp import Trajectory
from robot_energy_plan.optimization.chain import PowerChain

TIGHT = 1e-3  # of the energy, that pulls b to y^2 [-]
MIN_SPEED = 0.02  # of that of the path [-]
MAX_SPEED = 20.0  # [-]
SOLVED = ("Solved", "AlmostSolved")
PROBE = 1.0  # rad/s and N m at which the losses of drives are looked up


class PathPower(Described):
    """Figures of one path at N places, motor side where nothing else is said."""

    velocity: Annotated[Float, "q', joint side, shape (N, n). [rad/s] or [m/s]"]
    acceleration: Annotated[Float, "q'', joint side, shape (N, n). [rad/s^2] or [m/s^2]"]
    speed: Annotated[Float, "Motor velocity at y = 1, shape (N, n). [rad/s]"]
    still: Annotated[Float, "Torque against gravity, and Coulomb friction, shape (N, n). [N m]"]
    squared: Annotated[Float, "Torque per b, shape (N, n). [N m]"]
    rising: Annotated[Float, "Torque per a, shape (N, n). [N m s^2]"]
    viscous: Annotated[Float, "Torque per y, shape (N, n). [N m]"]
    gravity: Annotated[Float, "Torque that holds against gravity, shape (N, n). [N m]"]
    friction: Annotated[tuple[Float, Float], "Coulomb friction, and viscous per y, shape (N,). [W]"]
    constant: Annotated[float, "Loss of all drives that flows all the time. [W]"]
    loss: Annotated[tuple[Float, Float], "Loss of drives per path time and per y, shape (N,). [W]"]
    copper: Annotated[Float, "Loss per squared torque, shape (n,). [W/(N m)^2]"]

    def __getitem__(self, rows: slice) -> PathPower:
        """Return some of the places."""
        return PathPower(
            self.velocity[rows], self.acceleration[rows], self.speed[rows], self.still[rows],
            self.squared[rows], self.rising[rows], self.viscous[rows], self.gravity[rows],
            (self.friction[0][rows], self.friction[1][rows]), self.constant,
            (self.loss[0][rows], self.loss[1][rows]), self.copper,
        )  # fmt: skip


def path_power(chain: PowerChain, path: Trajectory) -> PathPower:
    """Return the figures of a path; of drives without a loss model the losses are 0.

    Args:
        path: The motion over its own time, shape (N, n) each.
    """
    degc = chain.motor_temperature_degc.mean(axis=0)
    q, v, a = path.joint_position, path.joint_velocity, path.joint_acceleration
    none = np.zeros_like(q)
    gravity, whole, rising = (
        chain.drivetrain.motor_torque_from_joint(chain.robot.joint_torque(q, *motion))
        for motion in ((none, none), (v, a), (none, v))
    )
    speed = chain.drivetrain.motor_velocity_from_joint(v)
    coulomb, viscous = chain.friction.coulomb, chain.friction.viscous(degc)
    turning = chain.friction.viscous_velocity(speed)
    constant, linear, quadratic, copper = _losses(chain, degc)
    size = np.abs(speed)
    return PathPower(
        velocity=v,
        acceleration=a,
        speed=speed,
        still=gravity + coulomb * np.sign(speed),
        squared=whole - gravity + chain.drivetrain.rotor_torque(a),
        rising=rising - gravity + chain.drivetrain.rotor_torque(v),
        viscous=viscous * turning,
        gravity=gravity,
        friction=((coulomb * size).sum(axis=1), (viscous * (turning * speed)).sum(axis=1)),
        constant=float(constant.sum()),
        loss=((linear * size).sum(axis=1), (quadratic * size**2).sum(axis=1)),
        copper=copper,
    )


def _losses(chain: PowerChain, degc: Float) -> tuple[Float, Float, Float, Float]:
    """Constant, linear, quadratic and copper loss of each drive, from its own function."""

    def loss(speed: float, torque: float) -> Float:
        shape = (1, len(degc))
        shaft = np.full(shape, speed * torque)
        power, _ = chain.drive.input_power(
            shaft, np.full(shape, speed), np.full(shape, torque), degc[None].copy()
        )
        return np.asarray((power - shaft)[0])

    constant = loss(0.0, 0.0)
    copper = np.maximum((loss(0.0, PROBE) - constant) / PROBE**2, 0.0)
    once, twice = loss(PROBE, 0.0) - constant, loss(2 * PROBE, 0.0) - constant
    quadratic = np.maximum((twice - 2 * once) / (2 * PROBE**2), 0.0)
    linear = np.maximum(once / PROBE - quadratic * PROBE, 0.0)
    return constant, linear, quadratic, copper


class LawLimits(Described):
    """What a law keeps to, joint side, shape (n,) each."""

    velocity: Annotated[Float, "[rad/s] or [m/s]"]
    acceleration: Annotated[Float, "Infinite where a joint does not move. [rad/s^2] or [m/s^2]"]
    jerk: Annotated[Float, "The same. [rad/s^3] or [m/s^3]"]
    torque: Annotated[Float, "Of the motors, infinite where none is known. [N m]"]


def time_law(
    places: PathPower, step: float, limits: LawLimits, bus_loss: float, price: float
) -> Float | None:
    """Return the speed along the path at its nodes, shape (N + 1,); None without a solution. [-]

    Args:
        places: Figures at the nodes and in the middle between them, 2 N + 1 of them.
        step: Path time between nodes. [s]
        bus_loss: Constant loss on the DC side. [W]
        price: Of a second: constant loss on the grid side and what else time costs or, with a
            minus, what waiting costs. [W]
    """
    program = _ConeProgram(len(places.speed) // 2)
    program.definitions(places[1::2], step, bus_loss)
    for part, share in ((places[1::2], 0.5), (places[:-1:2], 0.0), (places[2::2], 1.0)):
        program.limits(part, step, limits, share)
    solution = program.solve(step, price)
    return None if solution is None else np.clip(solution, MIN_SPEED, MAX_SPEED)


class _ConeProgram:
    """Rows ``A x + s = c`` with s in a cone; x = (y, b, u, e, z of each drive)."""

    def __init__(self, parts: int) -> None:
        self.parts = parts
        nodes = parts + 1
        self.y, self.b = np.arange(nodes), nodes + np.arange(nodes)
        self.u = 2 * nodes + np.arange(nodes)
        self.e = 3 * nodes + np.arange(parts)
        self.z: list[Any] = []
        self.size = 3 * nodes + parts
        self._linear: list[tuple[Any, Float]] = []
        self._cones: list[tuple[Any, Any, Any]] = []
        self._scale = 1.0

    def _unit(self, columns: Any, values: Float | float = 1.0) -> Any:
        from scipy.sparse import csr_array

        rows = len(columns)
        data = np.broadcast_to(np.asarray(values, dtype=np.float64), (rows,))
        return csr_array((data, (np.arange(rows), columns)), shape=(rows, self.size))

    def _speed(self, share: float = 0.5) -> Any:
        return (1.0 - share) * self._unit(self.y[:-1]) + share * self._unit(self.y[1:])

    def _square(self, factor: Float, share: float = 0.5) -> Any:
        before, after = (1.0 - share) * factor, share * factor
        return self._unit(self.b[:-1], before) + self._unit(self.b[1:], after)

    def _rise(self, factor: Float, step: float) -> Any:
        """The rise ``a`` of each part times a factor."""
        slope = 0.5 * factor / step
        return self._unit(self.b[1:], slope) - self._unit(self.b[:-1], slope)

    def _at_least(self, matrix: Any, least: Float) -> None:
        """``matrix x >= least``."""
        self._linear.append((-matrix, -least))

    def definitions(self, places: PathPower, step: float, bus_loss: float) -> None:
        """Tie u, b, z and e to the law."""
        from scipy.sparse import csr_array

        parts = self.parts
        lossy = np.flatnonzero(places.copper > 0)
        for index, _ in enumerate(lossy):
            self.z.append(self.size + index * parts + np.arange(parts))
        self.size += parts * len(lossy)
        nothing = np.zeros(parts)
        # 1 <= u y and y^2 <= b at nodes, k tau^2 <= z y between them
        none, ones = csr_array((parts + 1, self.size)), np.ones(parts + 1)
        u, y, b = (self._unit(columns) for columns in (self.u, self.y, self.b))
        self._cones.append(((u, 0 * ones), (y, 0 * ones), (none, ones)))
        self._cones.append(((b, 0 * ones), (none, ones), (y, 0 * ones)))
        spent = self._unit(self.u[:-1], 0.5) + self._unit(self.u[1:], 0.5)
        spent = (places.constant + bus_loss) * spent
        spent = spent + self._speed() * (places.friction[1] + places.loss[1])[:, None]
        offset = places.friction[0] + places.loss[0]
        offset = offset + (places.gravity * places.speed).sum(axis=1)
        spent = spent + self._square((places.squared * places.speed).sum(axis=1))
        spent = spent + self._rise((places.rising * places.speed).sum(axis=1), step)
        for column, joint in zip(self.z, lossy.tolist(), strict=True):
            root = np.sqrt(places.copper[joint])
            torque = self._torque(places, step, joint)
            self._cones.append(
                (
                    (self._unit(column), nothing),
                    (self._speed(), nothing),
                    (root * torque, root * places.still[:, joint]),
                )
            )
            spent = spent + self._unit(column)
        self._scale = max(float(np.abs(offset).mean()), places.constant + bus_loss, 1.0)
        self._at_least(self._unit(self.e) - spent, offset)
        self._at_least(self._unit(self.e), nothing)

    def _torque(self, places: PathPower, step: float, joint: int, share: float = 0.5) -> Any:
        """Torque of a motor without its part at standstill."""
        return (
            self._square(places.squared[:, joint], share)
            + self._rise(places.rising[:, joint], step)
            + self._speed(share) * places.viscous[:, joint][:, None]
        )

    def limits(self, places: PathPower, step: float, limits: LawLimits, share: float) -> None:
        """Keep speed, acceleration, jerk and torque at this share of each part."""
        with np.errstate(divide="ignore"):
            fast = np.minimum((limits.velocity / np.abs(places.velocity)).min(axis=1), MAX_SPEED)
        most = np.minimum(np.append(fast, MAX_SPEED), np.append(MAX_SPEED, fast))
        self._at_least(-self._unit(self.y), -most)
        self._at_least(-self._unit(self.b), -(most**2))
        self._at_least(self._unit(self.y), np.full(self.parts + 1, MIN_SPEED))
        for joint in range(places.velocity.shape[1]):
            if np.isfinite(limits.acceleration[joint]):
                moved = self._square(places.acceleration[:, joint], share) + self._rise(
                    places.velocity[:, joint], step
                )
                bound = np.full(self.parts, limits.acceleration[joint])
                self._at_least(moved, -bound)
                self._at_least(-moved, -bound)
                change = moved[1:] - moved[:-1]
                time = self._unit(self.u[1:-1], step)
                for sign in (1.0, -1.0):
                    self._at_least(
                        limits.jerk[joint] * time + sign * change, np.zeros(self.parts - 1)
                    )
            if np.isfinite(limits.torque[joint]):
                torque = self._torque(places, step, joint, share)
                for sign in (1.0, -1.0):
                    self._at_least(
                        -sign * torque, sign * places.still[:, joint] - limits.torque[joint]
                    )

    def solve(self, step: float, price: float) -> Float | None:
        """Minimise the energy from the grid and the price of time."""
        require("clarabel", "a time law")
        import clarabel
        from scipy.sparse import csc_matrix, vstack

        cost = np.zeros(self.size)
        cost[self.e] = step
        cost[self.u] = step * price
        cost[self.u[[0, -1]]] *= 0.5
        cost /= self._scale * step * self.parts
        cost[self.b] += TIGHT / (self.parts + 1)
        rows = [matrix for matrix, _ in self._linear]
        right = [values for _, values in self._linear]
        cones: list[Any] = [clarabel.NonnegativeConeT(sum(len(values) for values in right))]
        for (p, p0), (q, q0), (x, x0) in self._cones:  # x^2 <= p q: |(2x, p - q)| <= p + q
            count = len(p0)
            order = np.arange(3 * count).reshape(3, count).T.ravel()
            rows.append(-vstack([p + q, 2 * x, p - q], format="csr")[order])
            right.append(np.concatenate([p0 + q0, 2 * x0, p0 - q0])[order])
            cones += [clarabel.SecondOrderConeT(3)] * count
        settings: Any = clarabel.DefaultSettings()
        settings.verbose = False
        settings.max_threads = 1
        solver = clarabel.DefaultSolver(
            csc_matrix((self.size, self.size)), cost, csc_matrix(vstack(rows)),
            np.concatenate(right), cones, settings,
        )  # fmt: skip
        solution = solver.solve()
        if str(solution.status) not in SOLVED:
            return None
        return np.sqrt(np.maximum(np.asarray(solution.x)[self.b], 0.0))
