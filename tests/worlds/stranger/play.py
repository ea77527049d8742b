"""Effects of the direction of motion: backlash, rounded backlash and friction; all with a height of ±1 half width."""

from __future__ import annotations

import numpy as np

from tests.worlds.stranger.screws import Array

_LEVELS = np.array([0.35, 0.7, 1.0, 1.3, 1.65])
_SHARES = np.array([0.14, 0.22, 0.28, 0.22, 0.14])
"""Shares of parallel backlashes with a mean half width of one: sum(levels * shares) = 1."""


def lagging(x: Array, half: float, rounded: float = 0.0, begin: float = 0.0) -> Array:
    """Lag (n,) of a follower of x (n,): -half while x rises, +half while it falls.

    rounded 0: a single sharp backlash (measurement.md). Up to 1: parallel backlashes (Prandtl and Ishlinskii), and
    partly exponential friction (Dahl). begin (-1 … 1): start position of the follower in the gap.
    """
    if half == 0.0:
        return np.zeros_like(x)
    levels = half * (1 + rounded * (_LEVELS - 1)) if rounded else np.array([half])
    shares = _SHARES if rounded else np.ones(1)
    plays = _plays(x, levels, begin) @ shares
    if not rounded:
        return plays
    return (1 - rounded / 2) * plays + rounded / 2 * _dahl(x, half, begin)


def _plays(x: Array, half: Array, begin: float) -> Array:
    """Lags (n, k) of k followers that move only when pushed."""
    return np.stack([_follower(x.tolist(), h, x[0] + begin * h) for h in half.tolist()], axis=1) - x[:, None]


def _follower(x: list[float], half: float, y: float) -> list[float]:
    found = []
    for value in x:
        if y < value - half:
            y = value - half
        elif y > value + half:
            y = value + half
        found.append(y)
    return found


def _dahl(x: Array, half: float, begin: float) -> Array:
    """Lag of Dahl's friction, which approaches ∓half exponentially along the path with length `half`."""
    step = np.diff(x, prepend=x[0])
    keep = np.exp(-np.abs(step) / half)
    lag, now = [], begin * half
    for goal, kept in zip((-half * np.sign(step)).tolist(), keep.tolist(), strict=True):
        now = goal + (now - goal) * kept
        lag.append(now)
    return np.array(lag)


def reversals(t: Array, x: Array, swing: float = np.radians(0.02)) -> list[tuple[float, float]]:
    """Reversals of x (n,) by more than a swing: time and new direction (±1). After a rest, the time of
    departure.
    """
    extreme, direction, at, found = x[0], 0.0, t[0], []
    for now, value in zip(t.tolist(), x.tolist(), strict=True):
        if direction * (value - extreme) >= 0 and (direction or abs(value - extreme) < swing):
            if direction:
                extreme, at = value, now
            continue
        if abs(value - extreme) >= swing:
            if direction:
                found.append((at, -direction))
            direction, extreme, at = float(np.sign(value - extreme)), value, now
    return found
