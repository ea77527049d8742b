"""Independent simulation of two arms that hold a ball and a socket: kinematics and statics.

Nothing here is imported from rig. An arm is a chain of rotations and translations in the modified Denavit-Hartenberg
convention. Its errors are zeros, link constants, gear waves, compliance under the weight of the links, and a stiffness
that increases with the torque, which no fit models.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tests.worlds.chain import gravity_torques, link_frames

Array = NDArray[np.float64]
_DEG = np.pi / 180


@dataclass(frozen=True)
class Kind:
    """A type of arm: nominal constants by axis in mm and degrees, limits, and links with mass in kg and centre in
    mm.
    """

    name: str
    a: tuple[float, ...]
    alpha: tuple[float, ...]
    d: tuple[float, ...]
    limit: tuple[float, ...]
    mass: tuple[float, ...]
    centre: tuple[tuple[float, float, float], ...]
    zero_deg: float
    twist_deg: float
    length_mm: float
    soft: tuple[float, ...]
    build: str

    @property
    def axes(self) -> int:
        return len(self.a)


UR10E = Kind(
    "ur10e", (0, 0, -612.7, -571.55, 0, 0), (0, 90, 0, 0, 90, -90), (180.7, 0, 0, 174.15, 119.85, 116.55), (180,) * 6,
    (7.369, 13.051, 3.989, 2.1, 1.98, 0.615),
    ((21, -27, 0), (-232.7, 0, 158), (-331.55, 0, 68), (0, -18, 7), (0, 18, -7), (0, 0, -26)),
    0.04, 0.04, 0.4, (9e-6, 9e-6, 9e-6, 4e-5, 4e-5, 4e-5), "light",
)  # fmt: skip
IIWA = Kind(
    "kuka-lbr-iiwa-14", (0,) * 7, (0, -90, 90, 90, -90, -90, 90), (360, 0, 420, 0, 400, 0, 126),
    (165, 115, 165, 115, 165, 115, 170), (4, 4, 3, 2.7, 1.7, 1.8, 0.3),
    ((0, -30, -82.5), (-0.3, -59, 42), (0, 30, -85.5), (0, 67, 34), (-0.1, -21, -139.5), (0, -0.6, 0.4), (0, 0, -25)),
    0.04, 0.04, 0.4, (6.5e-5,) * 7, "torque_sensing",
)  # fmt: skip
FIVE = Kind(
    "light five", (0, 0, 350, 300, 0), (0, 90, 0, 0, 90), (220, 0, 0, 60, 110), (175, 110, 150, 175, 175),
    (3, 4, 2.5, 1.5, 0.6), ((0, 0, -30), (175, 0, 30), (150, 0, 20), (0, 0, 30), (0, 0, -30)),
    0.04, 0.04, 0.4, (9e-6, 9e-6, 9e-6, 4e-5, 4e-5), "light",
)  # fmt: skip
FOUR = Kind(
    "light four", (0, 0, 350, 320), (0, 90, 0, 90), (220, 40, 0, 120), (175, 110, 150, 175), (3, 4, 2.5, 1.0),
    ((0, 0, -30), (175, 0, 30), (160, 0, 20), (0, 0, -40)), 0.04, 0.04, 0.4, (9e-6, 9e-6, 9e-6, 4e-5), "light",
)  # fmt: skip


@dataclass(frozen=True)
class TrueArm:
    """True constants of an arm. Arrays (axes,) in mm, rad and rad/Nm; wave (axes, k, 2): sine and cosine of orders 1
    … k; point (3,) mm: ball or socket on the flange; stiffens: relative reduction of the compliance at 100 Nm.
    """

    kind: Kind
    a: Array
    alpha: Array
    beta: Array
    d: Array
    zero: Array
    wave: Array
    soft: Array
    stiffens: float
    point: Array
    up: Array

    def links(self, theta: Array) -> tuple[Array, Array]:
        """Rotations (n, axes, 3, 3) and origins (n, axes, 3) mm of all links in the base."""
        return link_frames(self.a, self.alpha, self.beta, self.d, theta)

    def true_angles(self, q: Array) -> Array:
        """True joint angles (n, axes) rad for reported ones."""
        orders = np.arange(1, self.wave.shape[1] + 1)
        turn = q[:, :, None] * orders
        waves = (self.wave[:, :, 0] * np.sin(turn) + self.wave[:, :, 1] * np.cos(turn)).sum(axis=2)
        torque = gravity_torques(*self.links(q), self.kind.mass, self.kind.centre, self.up)
        return q + self.zero + waves + self.soft * torque / (1 + self.stiffens * np.abs(torque) / 100)

    def tip_and_slope(self, q: Array) -> tuple[Array, Array, Array]:
        """Point (n, 3) mm in the base, its derivative (n, 3, axes) mm/rad for a rigid arm, and the flange
        z axis (n, 3).
        """
        R, p = self.links(self.true_angles(q))
        tip = p[:, -1] + np.einsum("nij,nj->ni", R[:, -1], np.broadcast_to(self.point, (len(q), 3)))
        slope = np.cross(R[:, :, :, 2], tip[:, None] - p).transpose(0, 2, 1)
        return tip, slope, R[:, -1, :, 2]

    def base_frame(self) -> Array:
        """Frame (4, 4) that the constants of axis 1 add to the base of the nominal arm."""
        nominal = nominal_arm(self.kind, self.point)
        return _first_link(self) @ np.linalg.inv(_first_link(nominal))


def _first_link(arm: TrueArm) -> Array:
    T = np.eye(4)
    R, p = link_frames(arm.a[:1], arm.alpha[:1], arm.beta[:1], arm.d[:1], arm.zero[None, :1])
    T[:3, :3], T[:3, 3] = R[0, 0], p[0, 0]
    return T


def _about(axis: str, angle: Array | float) -> Array:
    angle = np.atleast_1d(angle)
    c, s = np.cos(angle), np.sin(angle)
    R = np.zeros((len(angle), 3, 3))
    i = "xyz".index(axis)
    j, k = (i + 1) % 3, (i + 2) % 3
    R[:, i, i], R[:, j, j], R[:, k, k], R[:, j, k], R[:, k, j] = 1.0, c, c, -s, s
    return R


def nominal_arm(kind: Kind, point: Array, up: Array | None = None) -> TrueArm:
    """Arm of the data sheet."""
    zero = np.zeros(kind.axes)
    return TrueArm(
        kind, np.array(kind.a, float), np.radians(kind.alpha), zero, np.array(kind.d, float), zero,
        np.zeros((kind.axes, 1, 2)), zero, 0.0, np.array(point, float),
        np.array([0.0, 0.0, 1.0]) if up is None else up,
    )  # fmt: skip


def drawn_arm(kind: Kind, point: Array, rng: np.random.Generator, up: Array | None = None) -> TrueArm:
    """An arm of a kind with random errors; those of axis 1 belong to its base."""
    n = kind.axes
    nominal = nominal_arm(kind, point, up)
    parallel = np.abs(np.sin(nominal.alpha)) < 1e-3
    parallel[0] = False
    return replace(
        nominal,
        a=nominal.a + kind.length_mm * rng.normal(size=n),
        alpha=nominal.alpha + kind.twist_deg * _DEG * rng.normal(size=n),
        beta=kind.twist_deg * _DEG * rng.normal(size=n) * parallel,
        d=nominal.d + kind.length_mm * rng.normal(size=n),
        zero=kind.zero_deg * _DEG * rng.normal(size=n),
        wave=0.006 * _DEG * rng.normal(size=(n, 3, 2)) / np.array([1.0, 2.0, 3.0])[:, None],
        soft=np.array(kind.soft) * rng.uniform(0.5, 1.5, size=n),
        stiffens=float(rng.uniform(0.2, 0.6)),
        point=nominal.point + 2.0 * rng.normal(size=3),
    )


@dataclass(frozen=True)
class Cell:
    """Two arms, and the transform (4, 4) from the base of the second to that of the first, with the true bases of
    the arms.
    """

    first: TrueArm
    second: TrueArm
    base: Array

    @property
    def known_base(self) -> Array:
        """Transform (4, 4) between the frames of axis 1, the observable part."""
        return np.linalg.inv(self.first.base_frame()) @ self.base @ self.second.base_frame()


def drawn_cell(first: Kind, second: Kind, rng: np.random.Generator, apart_mm: float | None = None) -> Cell:
    """Draw two arms that face each other, with the second base displaced from its nominal place."""
    apart = 0.75 * (_reach(first) + _reach(second)) / 1.3 if apart_mm is None else apart_mm
    base = np.eye(4)
    base[:3, :3] = _about("z", np.pi + 0.05 * rng.normal())[0] @ _about("x", 0.01 * rng.normal())[0]
    base[:3, 3] = [apart + 10 * rng.normal(), 20 * rng.normal(), 10 * rng.normal()]
    up = base[2, :3]  # vertical of the first base in the frame of the second
    return Cell(
        drawn_arm(first, np.array([60.0, 20.0, 90.0]), rng), drawn_arm(second, np.array([-50.0, 30.0, 70.0]), rng, up),
        base,
    )  # fmt: skip


def _reach(kind: Kind) -> float:
    return float(np.abs(kind.a[1:]).sum() + np.abs(kind.d[2:]).sum())


def reached(arm: TrueArm, q: Array, goal: Array, rounds: int = 40) -> Array:
    """Return angles (n, axes) rad near q with the point of an arm at goals (n, 3) mm in its base."""
    q = q.copy()
    for _ in range(rounds):
        tip, J, _ = arm.tip_and_slope(q)
        inner = J @ J.transpose(0, 2, 1) + 1e-2 * np.eye(3)
        step = np.einsum("nji,nj->ni", J, np.linalg.solve(inner, (goal - tip)[..., None])[..., 0])
        q += step * np.minimum(1.0, 0.3 / np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-12))
    return q


def pair_postures(cell: Cell, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return postures q, p (count, axes) rad of both arms with the ball near the socket, their flanges facing within
    60°."""
    limits = [np.radians(arm.kind.limit) for arm in (cell.first, cell.second)]
    found_q: list[Array] = []
    found_p: list[Array] = []
    while len(found_q) < count:
        q, p = (rng.uniform(-limit, limit, size=(40 * count, len(limit))) for limit in limits)
        tip, _, z = cell.first.tip_and_slope(q)
        goal = (tip - cell.base[:3, 3]) @ cell.base[:3, :3]
        p = reached(cell.second, p, goal, 30)
        p = (p + np.pi) % (2 * np.pi) - np.pi
        near, _, towards = cell.second.tip_and_slope(p)
        facing = (z * (towards @ cell.base[:3, :3].T)).sum(axis=1) < -0.5
        good = (np.linalg.norm(near - goal, axis=1) < 1e-4) & (np.abs(p) < limits[1]).all(axis=1) & facing
        good &= tip[:, 2] > 50
        found_q += list(q[good])
        found_p += list(p[good])
    return np.array(found_q[:count]), np.array(found_p[:count])


def touched(
    cell: Cell, q: Array, p: Array, scatter_mm: float, rng: np.random.Generator, socket_mm: Array | None = None
) -> tuple[Array, Array]:
    """Reported angles of both arms with the ball in the socket, near postures q and p.

    The second arm is guided until the ball is seated, with a scatter. socket_mm (n, 3): socket on the second flange, if
    there are several.
    """
    tip = cell.first.tip_and_slope(q)[0] + scatter_mm * rng.normal(size=(len(q), 3))
    goal = (tip - cell.base[:3, 3]) @ cell.base[:3, :3]
    arm = cell.second if socket_mm is None else replace(cell.second, point=socket_mm)
    return q, reached(arm, p, goal, 15)


def touched_fixed(arm: TrueArm, q: Array, place: Array, scatter_mm: float, rng: np.random.Generator) -> Array:
    """Reported angles with the ball in fixed sockets at places (n, 3) mm in the base of an arm."""
    return reached(arm, q, place + scatter_mm * rng.normal(size=place.shape), 40)
