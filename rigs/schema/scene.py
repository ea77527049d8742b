"""What an effect sees and may change: one time-ordered trace on its way from the reported angles to the readings.

Effects replace parts of it, stage by stage; nothing is changed in place. The stages, in order:

    time    when the readings were really taken: `q` is what was reported then
    arm     the arm's constants
    joint   link-side angles `link_q`, which begin as `q`; every effect sees the reported ones, deviations add
    tool    where the tool is, `T`, after the forward kinematics
    setup   ball form and gauge places
    gauge   the readings `g_mm`

The simulator's own scene, `analysis/robot/model/scene.py`, does what stands here; a rig file is read without it.

A play is what follows in a gap, as a link in its gear or a plunger that sticks; its operator stands here as well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Stage = Literal["time", "arm", "joint", "tool", "setup", "gauge"]
STAGES: tuple[Stage, ...] = ("time", "arm", "joint", "tool", "setup", "gauge")


class Scene(Protocol):
    """n samples in order of time, k gauges. What a stage has not reached yet is empty."""

    @property
    def t_s(self) -> Array:
        """Times (n,) s."""

    @property
    def q(self) -> Array:
        """Reported angles (n, 6) rad."""

    @property
    def T(self) -> Array:  # noqa: N802 - a frame
        """Poses (n, 4, 4) of the tool in the world, places in mm."""

    @property
    def base_mm(self) -> Array:
        """Where the base of the arm stands in the world (3,) mm."""

    @property
    def samples_per_visit(self) -> int:
        """Samples of each visit of a table without times, whose visits do not follow each other; 0 for one trace."""

    @property
    def contact(self) -> Array:
        """Angles (n,) rad around the ball at which the link touches it."""

    @property
    def offsets_mm(self) -> Array:
        """Places (k,) mm of the gauges on the baseline."""

    def reported_at(self, t_s: Array) -> Array:
        """Reported angles (n, 6) rad at instants t_s (n,), the ends held."""

    def reversals(self, axis: int) -> Sequence[tuple[float, float]]:
        """When a joint (1 … 6) turns back, s, and the direction (±1) it takes then."""

    def torques(self, payload_kg: float = 0.0) -> Array:
        """Torque of gravity on each joint (n, 6) Nm, with so much more at the flange."""

    def moment(self) -> Array:
        """Moment of gravity (n, 3) Nm on the base, about its origin and in its axes."""

    def link_after(self, axis: int) -> tuple[Array, Array, Array]:
        """Place (n, 3) mm of a joint (1 … 6), direction (n, 3) of its axis, and place (n, 3) mm of its link's end,
        which is that of the joint where the link has no length."""

    def taken_at(self, t_s: Array) -> Self:
        """The scene as reported at other instants t_s (n,) s."""

    def with_constant(self, field: str, axis: int, delta: float) -> Self:
        """A constant of the arm (a, d in mm; alpha, beta in rad) of an axis (1 … 6) changed by delta."""

    def turned(self, axis: int, deviation: Array | float) -> Self:
        """The link side of a joint (1 … 6) turned by a deviation (n,) rad."""

    def along_rail(self, error_mm_m: Array) -> Self:
        """The tool moved by an error (3,) in mm for each metre along the rail that carries the arm: along it, across it
        and level, and across both; the same scene without a rail."""

    def tilted(self, turn: Array, below_mm: float) -> Self:
        """The whole arm turned by rotation vectors (n, 3) rad in the axes of its base, about the point that lies so far
        below the origin of the base."""

    def raised(self, height_mm: Array) -> Self:
        """The whole arm moved along the z of its base by (n,) mm."""

    def shifted(self, offset_mm: Array) -> Self:
        """The tool moved by (n, 3) mm in the world."""

    def with_form(self, form_mm: Array) -> Self:
        """The ball standing proud by (n,) mm where the link touches it."""

    def blended(self, before: Self, after: Self, share: float) -> Self:
        """The scene with a share of what an effect of joints or gauges changes from one scene to another."""

    def with_gauges_at(self, offsets_mm: Array) -> Self:
        """The gauges at other places (k,) mm on the baseline."""

    def read(self, gauge: str, change: Callable[[Array], Array]) -> Self:
        """One gauge's readings (n,) mm changed; the same scene in a test without that gauge."""

    def all_read(self, change: Callable[[Array], Array]) -> Self:
        """The readings (n, k) mm of all gauges changed."""


S = TypeVar("S", bound=Scene)
"""The scene that an effect is given and gives back."""


def plays_of_visits(x: Array, half: Array, samples: int) -> Array:
    """Return the followers (w, n) of visits of so many samples each, x (n,), in gaps of ± half (w,). Each visit begins
    in the middle of the gap, so that the order of the visits has no influence."""
    visits = x.reshape(-1, samples)
    followers: Array = np.repeat(visits[None], len(half), axis=0)
    gap = half[:, None]
    for k in range(1, samples):
        followers[:, :, k] = np.clip(followers[:, :, k - 1], visits[:, k] - gap, visits[:, k] + gap)
    return followers.reshape(len(half), -1)


def play(x: Array, half: float, begin: float = 0.0) -> Array:
    """The follower y (n,) of x (n,) in a gap of ± half; it begins in the middle, or `begin` (-1 … 1) of half beside it.

    The play operator (Visintin, Differential Models of Hysteresis, 1994): y moves only when x pushes one side of the
    gap. Over a stretch on which x is monotone it has the closed form used here.
    """
    follower: Array = plays(x, np.array([half]), begin)[0]
    return follower


def plays(x: Array, half: Array, begin: float = 0.0) -> Array:
    """The followers (w, n) of x (n,) in gaps of ± half (w,), all in the unit of x; each begins in the middle, or
    `begin` (-1 … 1) of its half beside it."""
    way = np.sign(np.diff(x))
    moving = np.flatnonzero(way)
    # Where x stands it goes on as it came: rounded angles stand at every other sample.
    turns = moving[1:][way[moving[1:]] != way[moving[:-1]]]
    # A turning point ends its stretch: the play is fully taken up there before it is left.
    ends = x[turns].tolist()
    entered = np.array([_entered(float(x[0]) + begin * gap, ends, gap) for gap in half.tolist()])
    stretches = np.diff([0, *(turns + 1).tolist(), len(x)])
    # On a monotone stretch at most one of the two bounds is ever active. In place this takes a quarter of the time.
    followers: Array = np.repeat(entered, stretches, axis=1)
    bound = x - half[:, None]
    np.maximum(followers, bound, out=followers)
    np.add(x, half[:, None], out=bound)
    np.minimum(followers, bound, out=followers)
    return followers


def _entered(first: float, ends: list[float], half: float) -> list[float]:
    """Where the follower is as it enters each stretch, from where x is at the end of the stretches before it."""
    entered = [first]
    for end in ends:
        if first < end - half:
            first = end - half
        elif first > end + half:
            first = end + half
        entered.append(first)
    return entered
