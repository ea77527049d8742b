"""Interface between effects and simulation: a time-ordered trace from the reported angles to the readings.

Effects replace parts of it in stages; nothing is changed in place. The stages, in order:

    time    true times of the readings: `q` becomes the angles reported at these times
    arm     constants of the arm
    joint   link-side angles `link_q`, initially `q`; every effect sees the reported angles, deviations add up
    tool    tool poses `T`, after the forward kinematics
    setup   ball form and gauge positions
    gauge   the readings `g_mm`

`analysis/robot/predict.py` implements this interface.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Stage = Literal["time", "arm", "joint", "tool", "setup", "gauge"]
STAGES: tuple[Stage, ...] = ("time", "arm", "joint", "tool", "setup", "gauge")
OUTSIDE_ARM: tuple[Stage, ...] = ("time", "setup", "gauge")
"""Stages of the instruments. Effects of these stages are not errors of the arm."""


class Scene(Protocol):
    """Scene with n samples in order of time and k gauges. Values of later stages are empty."""

    @property
    def t_s(self) -> Array:
        """Times (n,) in s."""

    @property
    def q(self) -> Array:
        """Reported angles (n, 6) in rad."""

    @property
    def T(self) -> Array:  # noqa: N802 - a frame
        """Poses (n, 4, 4) of the tool in the world, with positions in mm."""

    @property
    def base_mm(self) -> Array:
        """Position (3,) in mm of the arm base in the world."""

    @property
    def samples_per_visit(self) -> int:
        """Samples in each visit of a table without times, whose visits do not follow each other; 0 for a trace."""

    @property
    def contact(self) -> Array:
        """Contact angles (n,) in rad of the link around the ball."""

    @property
    def offsets_mm(self) -> Array:
        """Positions (k,) in mm of the gauges on the baseline."""

    def reported_at(self, t_s: Array) -> Array:
        """Reported angles (n, 6) in rad at times t_s (n,), constant beyond the ends."""

    def reversals(self, axis: int) -> Sequence[tuple[float, float]]:
        """Reversals of a joint (1 … 6): time in s, and new direction (±1)."""

    def torques(self, payload_kg: float = 0.0) -> Array:
        """Gravity torque (n, 6) in Nm on each joint, with an additional payload at the flange."""

    def moment(self) -> Array:
        """Gravity moment (n, 3) in Nm on the base, about the origin and in the axes of the base."""

    def link_after(self, axis: int) -> tuple[Array, Array, Array]:
        """Joint position (n, 3) in mm, axis direction (n, 3), and end of the link (n, 3) in mm for a joint (1 … 6)."""

    def taken_at(self, t_s: Array) -> Self:
        """Scene as reported at other times t_s (n,) in s."""

    def with_constant(self, field: str, axis: int, delta: float) -> Self:
        """Scene with a constant of an axis (1 … 6) changed by delta: a, d in mm; alpha, beta in rad."""

    def turned(self, axis: int, deviation: Array | float) -> Self:
        """Scene with the link side of a joint (1 … 6) turned by a deviation (n,) in rad."""

    def along_rail(self, error_mm_m: Array) -> Self:
        """Scene with the tool moved by an error (3,) in mm per metre of the rail, if any.

        Components: along the rail, across it horizontally, and across both.
        """

    def tilted(self, turn: Array, below_mm: float) -> Self:
        """Scene with the arm turned by rotation vectors (n, 3) in rad in base axes.

        below_mm: depth of the centre of rotation below the base origin.
        """

    def raised(self, height_mm: Array) -> Self:
        """Scene with the arm moved along the z axis of the base by (n,) mm."""

    def shifted(self, offset_mm: Array) -> Self:
        """Scene with the tool moved by (n, 3) mm in the world."""

    def with_form(self, form_mm: Array) -> Self:
        """Scene with a ball radius larger by (n,) mm at the contact."""

    def blended(self, before: Self, after: Self, share: float) -> Self:
        """Scene with a share of the change made by a joint or gauge effect."""

    def with_gauges_at(self, offsets_mm: Array) -> Self:
        """Scene with gauges at other positions (k,) mm on the baseline."""

    def read(self, gauge: str, change: Callable[[Array], Array]) -> Self:
        """Scene with changed readings (n,) in mm of a gauge; unchanged if the test does not use it."""

    def all_read(self, change: Callable[[Array], Array]) -> Self:
        """Scene with changed readings (n, k) in mm of all gauges."""


S = TypeVar("S", bound=Scene)
"""Scene passed to and returned by an effect."""


def plays_of_visits(x: Array, half: Array, samples: int) -> Array:
    """Positions (w, n) of a part dragged with play along visits x (n,), each with `samples` samples.

    half (w,): half of the play. Each visit starts in the middle of the play, so the order of the visits has no
    influence.
    """
    visits = x.reshape(-1, samples)
    followers: Array = np.repeat(visits[None], len(half), axis=0)
    gap = half[:, None]
    for k in range(1, samples):
        followers[:, :, k] = np.clip(followers[:, :, k - 1], visits[:, k] - gap, visits[:, k] + gap)
    return followers.reshape(len(half), -1)


def play(x: Array, half: float, begin: float = 0.0) -> Array:
    """Position y (n,) of a part dragged along x (n,) with a play of ± half, from `begin` (-1 … 1) times half.

    Play operator (Visintin, Differential Models of Hysteresis, 1994): y moves only when x pushes against a side of the
    gap. On a monotone section it has the closed form used here.
    """
    follower: Array = plays(x, np.array([half]), begin)[0]
    return follower


def plays(x: Array, half: Array, begin: float = 0.0) -> Array:
    """Positions (w, n) of a part dragged along x (n,) with plays of ± half (w,), all in the unit of x.

    begin: start position (-1 … 1) in units of half.
    """
    way = np.sign(np.diff(x))
    moving = np.flatnonzero(way)
    # An x at rest keeps the direction: rounded angles repeat in every other sample.
    turns = moving[1:][way[moving[1:]] != way[moving[:-1]]]
    # A turning point ends the section, because the gap is fully closed there.
    ends = x[turns].tolist()
    entered = np.array([_entered(float(x[0]) + begin * gap, ends, gap) for gap in half.tolist()])
    stretches = np.diff([0, *(turns + 1).tolist(), len(x)])
    # At most one bound is active on a monotone section. Computing in place takes a quarter of the time.
    followers: Array = np.repeat(entered, stretches, axis=1)
    bound = x - half[:, None]
    np.maximum(followers, bound, out=followers)
    np.add(x, half[:, None], out=bound)
    np.minimum(followers, bound, out=followers)
    return followers


def _entered(first: float, ends: list[float], half: float) -> list[float]:
    """Follower at the start of each section. ends: x at the ends of the previous sections."""
    entered = [first]
    for end in ends:
        if first < end - half:
            first = end - half
        elif first > end + half:
            first = end + half
        entered.append(first)
    return entered
