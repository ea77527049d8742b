"""Independent simulation of cells in which one part has moved: arms, touches and tracker readings.

Nothing here is imported from rig. Frames are products of rotations and translations in the modified Denavit-Hartenberg
convention, written from the textbook. An arm has errors of every constant, gear waves and sagging links.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tests.worlds.chain import link_frames

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Kind:
    """A type of arm: nominal constants by axis from the data sheet, and the tool position in mm."""

    name: str
    a: tuple[float, ...]
    alpha_deg: tuple[float, ...]
    d: tuple[float, ...]
    low_deg: tuple[float, ...]
    high_deg: tuple[float, ...]
    tool: tuple[float, float, float]


SIX = Kind(
    "six axes", (0, 0, -612.7, -571.55, 0, 0), (0, 90, 0, 0, 90, -90), (180.7, 0, 0, 174.15, 119.85, 116.55),
    (-180,) * 6, (180,) * 6, (50.0, 20.0, 100.0),
)  # fmt: skip
SEVEN = Kind(
    "seven axes", (0,) * 7, (0, -90, 90, 90, -90, -90, 90), (360, 0, 420, 0, 400, 0, 126),
    (-165, -115, -165, -115, -165, -115, -170), (165, 115, 165, 115, 165, 115, 170), (40.0, 10.0, 90.0),
)  # fmt: skip


@dataclass(frozen=True)
class TrueArm:
    """True constants of an arm. Arrays (axes,) in mm and rad; wave (axes, 2): sine and cosine of the angle; sag
    (axes,): rad per metre of horizontal reach.
    """

    kind: Kind
    a: Array
    alpha: Array
    d: Array
    zero: Array
    wave: Array
    sag: Array
    tool: Array
    base: Array = field(default_factory=lambda: np.eye(4))

    def tips(self, q: Array) -> Array:
        """Positions (n, 3) mm of the ball on the tool at reported angles q (n, axes) rad."""
        return self.tips_and_slopes(q)[0]

    def tips_and_slopes(self, q: Array) -> tuple[Array, Array]:
        """Ball positions (n, 3) mm and their derivatives (n, 3, axes) mm/rad for the rigid arm."""
        reach = np.linalg.norm(self._rigid(q)[0][:, :2], axis=1) / 1000
        error = self.zero + self.wave[:, 0] * np.sin(q) + self.wave[:, 1] * np.cos(q)
        tips, slopes = self._rigid(q + error + self.sag * reach[:, None])
        R = self.base[:3, :3]
        return tips @ R.T + self.base[:3, 3], R @ slopes

    def _rigid(self, q: Array) -> tuple[Array, Array]:
        R, p = link_frames(self.a, self.alpha, 0.0, self.d, q)
        tips = p[:, -1] + R[:, -1] @ self.tool
        return tips, np.cross(R[:, :, :, 2], tips[:, None] - p).swapaxes(1, 2)


def drawn_arm(kind: Kind, rng: np.random.Generator) -> TrueArm:
    axes = len(kind.a)
    deg = np.pi / 180
    return TrueArm(
        kind, np.array(kind.a) + 0.2 * rng.normal(size=axes),
        np.radians(kind.alpha_deg) + 0.02 * deg * rng.normal(size=axes),
        np.array(kind.d) + 0.2 * rng.normal(size=axes), 0.05 * deg * rng.normal(size=axes),
        0.003 * deg * rng.normal(size=(axes, 2)),
        np.abs(0.005 * deg * rng.normal(size=axes)) * (np.arange(axes) < 3),
        np.array(kind.tool) + 2.0 * rng.normal(size=3),
    )  # fmt: skip


def _step(arm: TrueArm, q: Array, place: Array) -> Array:
    """Damped step (n, axes) rad that moves the balls to a place (3,) or places (n, 3) mm."""
    tips, J = arm.tips_and_slopes(q)
    inner = J @ J.transpose(0, 2, 1) + np.eye(3)
    return np.asarray(np.einsum("nji,nj->ni", J, np.linalg.solve(inner, (place - tips)[..., None])[..., 0]))


def postures(arm: TrueArm, place: Array, count: int, rng: np.random.Generator) -> Array:
    """Return random reported angles (count, axes) rad with the ball at a place (3,) mm, by Newton's method from
    random postures.
    """
    found: list[Array] = []
    low, high = np.radians(arm.kind.low_deg), np.radians(arm.kind.high_deg)
    while len(found) < count:
        q = rng.uniform(low, high, size=(2 * count + 4, len(low)))
        for _ in range(25):
            step = _step(arm, q, place)
            q = q + step * np.minimum(1.0, 0.3 / np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-9))
        q = (q + np.pi) % (2 * np.pi) - np.pi
        good = (np.linalg.norm(place - arm.tips(q), axis=1) < 1e-7) & (q > low).all(axis=1) & (q < high).all(axis=1)
        found += list(q[good])
    return np.array(found[:count])


@dataclass(frozen=True)
class Change:
    """Movements: shift (3,) mm and rotation vector (3,) rad of the base about its own origin, shift of the tool (3,)
    mm, changes of the zeros (axes,) rad, and shifts of sockets by name (3,) mm.
    """

    base: Array
    turn: Array
    tool: Array
    zero: Array
    sockets: dict[str, Array]


def no_change(axes: int) -> Change:
    """A change without any movement."""
    return Change(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(axes), {})


def _direction(rng: np.random.Generator) -> Array:
    v = rng.normal(size=3)
    return np.asarray(v / np.linalg.norm(v))


def drawn_change(cause: str, axes: int, rng: np.random.Generator) -> Change:
    """A random change for a cause: nothing, base, tool, socket, `zero 3`, or two of them joined by a plus."""
    change = no_change(axes)
    for one in cause.split("+"):
        what, _, axis = one.partition(" ")
        if what == "base":
            change = Change(0.5 * _direction(rng), 0.5e-3 * _direction(rng), change.tool, change.zero, change.sockets)
        elif what == "tool":
            change = Change(change.base, change.turn, 0.7 * _direction(rng), change.zero, change.sockets)
        elif what == "socket":
            change = Change(change.base, change.turn, change.tool, change.zero, {"A": 0.5 * _direction(rng)})
        elif what == "zero":
            zero = change.zero.copy()
            zero[int(axis) - 1] = np.radians(rng.uniform(0.03, 0.1)) * rng.choice([-1, 1])
            change = Change(change.base, change.turn, change.tool, zero, change.sockets)
    return change


def changed_arm(arm: TrueArm, change: Change) -> TrueArm:
    angle = float(np.linalg.norm(change.turn))
    base = np.eye(4)
    if angle > 0:
        k = change.turn / angle
        K = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
        base[:3, :3] = np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
    base[:3, 3] = change.base
    return TrueArm(arm.kind, arm.a, arm.alpha, arm.d, arm.zero + change.zero, arm.wave, arm.sag,
                   arm.tool + change.tool, base @ arm.base)  # fmt: skip


SOCKETS = {"A": np.array([600.0, -150.0, 250.0]), "B": np.array([420.0, 420.0, 400.0])}
"""Two sockets in the work area, in mm."""


def touched(
    arm: TrueArm, q: Array, sockets: Sequence[str], change: Change, scatter_mm: float, rng: np.random.Generator
) -> Array:
    """Reported angles (n, axes) rad with the ball in sockets, guided by hand near angles q (n, axes).

    The ball is exactly in the socket, except for the seating scatter.
    """
    goal = np.array([SOCKETS[name] + change.sockets.get(name, 0.0) for name in sockets])
    goal = goal + scatter_mm * rng.normal(size=goal.shape)
    q = q.copy()
    for _ in range(8):
        q += _step(arm, q, goal)
    return q
