"""What a tracker wrote while a tool drove paths, divided into moves: the pieces between two stands of the tool.

Places are averaged over short spans, so that the tracker's noise, which is read off the second differences of its
places, is no motion. A stand is a rest of more than half a second: a corner, at which some controllers all but stop,
takes less. What lies before the first and after the last stand is cut off: how much of it is missing is unknown.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.kinematics.arm import Array

_SPAN_S, _SAMPLES = 0.05, 4
"""Places are averaged over this time, and over so many of them at the least."""
_STAND_S = 0.6
_SLOW = 0.02
"""A tool is at rest below this share of the speed that nine tenths of all spans stay below …"""
_NOISES = 6.0
"""… or where noise alone looks as fast, so many times its standard deviation."""
_GAP_S = 0.3
"""A move in which the tracker wrote nothing for longer is not whole: it lost its target."""
_NORMAL = 1.4826
"""Standard deviation of a normal law over its median without sign."""


@dataclass(frozen=True)
class Moved:
    """One move: rows of the table from `first` to before `last`, the way length_mm, by spans, and from its beginning to
    its end chord_mm; whole: whether the tracker wrote all along it."""

    first: int
    last: int
    length_mm: float
    chord_mm: float
    whole: bool


def moves_of(t_s: Array, xyz_mm: Array) -> list[Moved]:
    """Return the moves between stands, in order, of places xyz_mm (n, 3) at rising times t_s (n,)."""
    if len(t_s) < 10 * _SAMPLES:
        return []
    step_s = float(np.median(np.diff(t_s)))
    span_s = max(_SPAN_S, _SAMPLES * step_s)
    number = ((t_s - t_s[0]) / span_s).astype(np.int64)
    first = np.flatnonzero(np.diff(number, prepend=-1))
    count = np.diff(first, append=len(t_s))
    at = np.add.reduceat(xyz_mm, first, axis=0) / count[:, None]
    when = np.add.reduceat(t_s, first) / count
    way = np.linalg.norm(np.diff(at, axis=0), axis=1)
    speed = way / np.diff(when)
    bends = np.abs(xyz_mm[2:] - 2 * xyz_mm[1:-1] + xyz_mm[:-2])
    noise_mm = float(_NORMAL * np.median(bends) / np.sqrt(6))  # the standard deviation of a coordinate
    noise = noise_mm * np.sqrt(6 / max(float(np.median(count)), 1.0)) / span_s
    rests = speed < max(_SLOW * float(np.quantile(speed, 0.9)), _NOISES * noise)
    # The first and the last span (k,) of each stand.
    edges = np.diff(np.concatenate([[False], rests, [False]]).astype(np.int64))
    begins, ends = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
    long = when[ends] - when[begins] > _STAND_S
    begins, ends = begins[long], ends[long]
    gaps = np.concatenate([[0], np.cumsum(np.diff(t_s) > max(_GAP_S, 3 * span_s))])
    moves = []
    for out, back in zip(ends[:-1].tolist(), begins[1:].tolist(), strict=True):
        rows = int(first[out]), int(first[back])
        chord = float(np.linalg.norm(at[back] - at[out]))
        moves.append(Moved(*rows, float(way[out:back].sum()), chord, bool(gaps[rows[1]] == gaps[rows[0]])))
    return moves
