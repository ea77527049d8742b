"""Peaks of a curve that stand out, as `scipy.signal.find_peaks` finds them: importing that takes half a second, more
than a diagnosis of a small run."""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Array, Integers
from rigs.schema.play import play


def peaks(x: Array, prominence: float) -> Integers:
    """Return the rows at which x (n,) has a peak that stands out by more than `prominence`, in the unit of x, on both
    sides. Of a flat top it is the middle, and of tops of one height the first."""
    # A follower in a gap moves down again only after a fall by the whole gap.
    follower = np.diff(play(x, prominence / 2))
    moving = np.flatnonzero(follower)
    way = np.sign(follower[moving])
    rows = []
    for k in np.flatnonzero(np.diff(way) < 0):
        between = x[moving[k] : moving[k + 1] + 1]
        first = int(np.argmax(between))
        flat = int(np.argmax(np.append(between[first:] != between[first], True)))
        row = int(moving[k]) + first + (flat - 1) // 2
        # The gap begins in the middle, so the first rise may be half of it.
        if x[row] - x[:row].min() > prominence:
            rows.append(row)
    return np.array(rows, dtype=np.int64)
