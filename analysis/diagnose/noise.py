"""How noisy the readings are, from what differs between repeated runs: of each order, and of how a run sits.

From run to run every joint and the ball sit a little elsewhere. That scatter moves all readings of a run together, in a
way that the arm's geometry gives; it is told apart from the noise of the readings, whose spectrum is pooled over bands.
Where nothing was repeated both are assumed, and the answer says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from analysis.fitting.observation import Observation, predicted, seen
from analysis.kinematics.arm import Array
from analysis.model.predict import Model, SetUp, moved
from analysis.model.simulate import Noise as Cell
from analysis.reading.tables import Integers, PoseTable
from rigs.effects import turned

_ASSUMED_MM = {"circle": 0.0015, "target": 0.002, "pose": 0.04}
_LEAST_MM = 1e-5
_WANDER, _SLOW = 12.0, 15.0
"""Power of a good cell's wander at low orders, in that of the white noise, and the order at which it has half of it."""
_FINE = 100
"""Orders from here on are white noise alone."""
_MULTIPLES = (0.0, 0.1, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0, 8.0, 15.0)
"""Scatter of joints and ball that is looked for, in that of a good cell."""


@dataclass(frozen=True)
class RunNoise:
    """sd_mm (N,): of each entry of one run, of an order (N,); joints, ball: scatter from run to run in that of a good
    cell; measured: whether repeats told; averaged: what a circle's grid leaves of the power of white noise."""

    sd_mm: Array
    joints: float
    ball: float
    measured: bool
    order: Integers
    averaged: float

    def scatter(self, terms: int) -> Array:
        """(terms,): six joints, then the ball where it is one of them."""
        return np.array([self.joints] * 6 + [self.ball] * 3)[:terms]


def shaken_by(model: Model, one: Observation, setup: SetUp) -> Array:
    """What a good cell's scatter of each joint and of the ball adds to the readings, (m, k, 9) mm; for poses, whose
    instrument's place is fitted anyway, of the joints alone (m, 3, 6)."""
    good = Cell()
    scene = moved(model, one.path)
    base = seen(model, one, scene, setup)
    columns = []
    for axis in range(1, 7):
        shaken = replace(model, effects=(*model.effects, turned(axis, good.scatter_deg)))
        columns.append(predicted(shaken, one, setup) - base)
    if not isinstance(one.table, PoseTable):
        steps = good.scatter_mm * np.eye(3)
        columns += [seen(model, one, scene, replace(setup, ball=setup.ball + step)) - base for step in steps]
    return np.stack(columns, axis=2)


def noise_of(groups: Sequence[tuple[Array, Array]], order: Integers, bands: Sequence[int], averaged: float) -> RunNoise:
    """Noise of circles. groups: residuals (n, N) mm of repeated runs and how scatter shows in them (N, 9) mm.

    order (N,): cycles a lap of each entry, sum of the gauges first; bands: edges within which the noise is pooled.
    """
    repeated = [(rows - rows.mean(axis=0), _span(shaken), shaken) for rows, shaken in groups if len(rows) > 1]
    if not repeated:
        # A slow wander makes the low orders several times as noisy as the high ones.
        sd = _ASSUMED_MM["circle"] * np.sqrt(1 + _WANDER / (1 + (order / _SLOW) ** 2))
        return RunNoise(sd, 1.0, 1.0, measured=False, order=order, averaged=averaged)
    sd = _spectrum(repeated, order, bands)
    joints, ball = _scatter([(apart, shaken) for apart, _, shaken in repeated], sd)
    return RunNoise(sd, joints, ball, measured=True, order=order, averaged=averaged)


def reading_sd(rows: Array, shaken: Array, noise: RunNoise, rounding_deg: Array, *, poses: bool) -> Array:
    """Standard deviation (N,) mm of readings at targets.

    From repeats (n, N), or from the same gauges' circles with what the rounding of reported angles adds (by shaken
    (N, c)), or assumed.
    """
    if len(rows) > 1:
        apart = rows - rows.mean(axis=0)
        pooled = float(np.sqrt((apart**2).sum() / ((len(rows) - 1) * rows.shape[1])))
        return np.full(rows.shape[1], max(pooled, 10 * _LEAST_MM))
    if poses or not noise.measured:
        return np.full(rows.shape[1], _ASSUMED_MM["pose" if poses else "target"])
    # Between two rows of a circle white noise is averaged; at a target it is not.
    fine = float(np.mean(noise.sd_mm[noise.order >= _FINE] ** 2))
    slow = float(np.mean(noise.sd_mm**2)) - fine
    rounded = shaken[:, :6] * rounding_deg / Cell().scatter_deg
    sd: Array = np.sqrt(max(slow, 0.0) + fine / noise.averaged + (rounded**2).sum(axis=1))
    return sd


def _span(columns: Array) -> Array:
    """An orthonormal basis of columns, what is next to nothing left out."""
    left, size, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(left[:, size > 1e-3 * size[0]], dtype=float)


def _spectrum(repeated: Sequence[tuple[Array, Array, Array]], order: Integers, bands: Sequence[int]) -> Array:
    """Standard deviation (N,) mm by channel and band, of what scatter cannot have done."""
    squares, freedom = np.zeros(len(order)), np.zeros(len(order))
    for apart, span, _ in repeated:
        own = apart - (apart @ span) @ span.T
        squares += (own**2).sum(axis=0)
        freedom += (len(apart) - 1) * (1 - (span**2).sum(axis=1))
    sd = np.empty(len(order))
    half = len(order) // 2
    for channel in (np.arange(half), np.arange(half, len(order))):
        for low, high in pairwise(bands):
            band = channel[(order[channel] >= low) & (order[channel] < high)]
            free = max(freedom[band].sum(), 1.0)
            # Few repeats leave a band's noise uncertain; a little more than its mean keeps the tails honest.
            sd[band] = np.sqrt(squares[band].sum() / free * (1 + 2 / free))
    return np.maximum(sd, _LEAST_MM)


def _scatter(repeated: Sequence[tuple[Array, Array]], sd: Array) -> tuple[float, float]:
    """The multiples of a good cell's scatter of joints and of ball that make the differences most likely."""
    seen = []
    for apart, shaken in repeated:
        columns = shaken / sd[:, None]
        span = _span(columns)
        inside = span.T @ columns
        Z = (apart / sd) @ span
        seen.append((len(apart) - 1, Z, inside[:, :6] @ inside[:, :6].T, inside[:, 6:] @ inside[:, 6:].T))

    def likelihood(multiples: tuple[float, float]) -> float:
        total = 0.0
        for freedom, Z, joints, ball in seen:
            C = np.eye(len(joints)) + multiples[0] ** 2 * joints + multiples[1] ** 2 * ball
            total -= 0.5 * (freedom * np.linalg.slogdet(C)[1] + np.sum(Z * np.linalg.solve(C, Z.T).T))
        return float(total)

    return max(((joints, ball) for joints in _MULTIPLES for ball in _MULTIPLES), key=likelihood)
