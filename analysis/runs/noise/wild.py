"""Wild readings: those so far from all others that no effect of a robot explains them. One rule for every test.

What is fitted to all readings follows a wild one: a single lost point of a tracker among 130 poses moved the base and
made an rms of 165 mm of one of 0.14 mm. So the fit is made again to the readings that were near, a few times, and what
then lies far away is wild. Readings that are many, or that share a range of a joint, are no accident of an instrument:
they show what the model lacks, and none of them is wild.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from analysis.robot.kinematics.arm import Array, Mask

SPREADS, NEAR = 10.0, 2.5
"""Robust standard deviations from which a reading is wild, and up to which it counts in the fit. Chosen: as for the
sphere of a radial test, and usual; the 2127 poses of the measured UR10 lie within 2 of the nominal arm."""
FITTED_SPREADS = 5.0
"""Robust standard deviations from which a pose is wild beside an arm whose constants are fitted, at import and among
held-out poses alike. Measured: of 1600 poses of a UR10 and a UR5, in sets of 30 to 400, the farthest lay at 4.2; on the
UR5, which leaves 0.1 mm, a reading 0.8 mm off is seen in 14 of 14 sets (6 of 14 from 6 on), one 1 mm off too."""
STEPS = 4
"""Number of fits, each to the readings that are near after the one before (Rousseeuw's concentration steps): fitted to
all of them, one wild reading in nine hid itself."""
_FEW = 30
"""Each of up to so many readings is left out by itself to begin with, which takes as many fits."""
MOST = 0.1
"""More than this share of readings, and more than one, are no accident."""
_RANGE = 3
"""So many wild readings with a range of a joint to themselves are no accident: of three in 130 placed at random, the
chance is 0.002 for six joints."""


def spreads_of(distances: Array, least: float) -> Array:
    """Distances (n,) from a model, in mm or rad, in robust standard deviations, taken to be `least` at the least."""
    sd = max(1.4826 * float(np.median(distances)), least)
    return distances / sd


def far_from_fit(distances_of: Callable[[Mask], Array], count: int, least: float) -> tuple[Array, Array]:
    """Distances (n,) in mm or rad of `count` readings from a model fitted to those that are near, and the same in
    robust standard deviations. distances_of: fits the model to some of the readings, and gives the distances of all."""
    near = np.ones(count, dtype=bool)
    # Of a few, all but the one without which the others fit best, unless all fit with a scale of `least`. Among nine,
    # fitted by nine unknowns, the steps alone do not always find it.
    if count <= _FEW and not float(np.sqrt(np.mean(distances_of(near) ** 2))) < SPREADS * least / np.sqrt(count):
        but_one = ~np.eye(count, dtype=bool)
        rms = [float(np.sqrt(np.mean(distances_of(those)[those] ** 2))) for those in but_one]
        near = but_one[int(np.argmin(rms))]
    distances = spreads = np.zeros(count)
    for _ in range(STEPS):
        distances = distances_of(near)
        spreads = spreads_of(distances, least)
        near = spreads <= NEAR
    return distances, spreads


def by_accident(far: Mask, q: Array) -> bool:
    """Whether far readings (n,) are few, and have no range of any joint to themselves: angles q (n, 6) rad."""
    count = int(far.sum())
    if count > max(1.0, MOST * len(far)):
        return False
    if count < _RANGE:
        return True
    low, high = q[far].min(axis=0), q[far].max(axis=0)
    others = ((q[~far] >= low) & (q[~far] <= high)).any(axis=0)
    return bool(others.all())
