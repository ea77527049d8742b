"""Outliers: readings farther from all others than any effect of a robot can explain. All tests use this rule.

A fit to all readings follows an outlier: a single lost point of a tracker among 130 poses moved the base and increased
an rms of 0.14 mm to 165 mm. The fit is therefore repeated a few times with the readings near the previous fit. Readings
that are still distant are outliers. However, if there are very many distant readings, or many in a row, or if they
share a range of a joint, the cause is an error of the model or a movement, and not an accident of the instrument. None
of them is then an outlier.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from analysis.robot.kinematics.arm import Array, Mask

SPREADS, NEAR = 10.0, 2.5
"""Limits in robust standard deviations: above the first a reading is an outlier; up to the second it is used in the
fit.

Chosen: as for the sphere of a radial test, and usual. The 2127 poses of the measured UR10 are within 2 standard
deviations of the nominal arm.
"""
FITTED_SPREADS = 5.0
"""Robust standard deviations from which a pose is an outlier for an arm with fitted constants, both at import and
among held-out poses. Measured: of 1600 poses of a UR10 and a UR5, in sets of 30 to 400, the farthest was at 4.2.
On the UR5, with a residual of 0.1 mm, a reading wrong by 0.8 mm is detected in 14 of 14 sets (6 of 14 with a
limit of 6), and also at 1 mm."""
STEPS = 4
"""Number of fits, each to the readings near the previous fit (Rousseeuw's concentration steps): a fit to all
readings did not reveal a single outlier in nine."""
_FEW = 30
"""Number of readings up to which each reading is first omitted in turn, at the cost of a fit per reading."""
FEW, MOST = 0.1, 0.3
"""Shares of readings: up to the first, outliers are an accident; up to the second, if they are also scattered over the
table. Chosen: of more than a third, the fits above do not always find the sound readings.
"""
_SCATTERED = 0.5
"""Smallest number of blocks of successive outliers, as a share of the number at random: a target or instrument that has
moved makes one or two blocks."""
_RANGE = 3
"""Number of outliers in a separate range of a joint that is not an accident: for three in 130 placed at random, the
chance is 0.002 for six joints."""


def spreads_of(distances: Array, least: float) -> Array:
    """Distances (n,) from a model, in mm or rad, as multiples of the robust standard deviation, which is at
    least `least`."""
    sd = max(1.4826 * float(np.median(distances)), least)
    return distances / sd


def far_from_fit(distances_of: Callable[[Mask], Array], count: int, least: float) -> tuple[Array, Array]:
    """Distances (n,) in mm or rad of `count` readings from a model fitted to the near readings.

    The second result is the same in robust standard deviations. distances_of: fits the model to some of the readings,
    and returns the distances of all.
    """
    near = np.ones(count, dtype=bool)
    # For a small number of readings, first omit the reading whose omission gives the smallest rms, unless all fit with
    # a scale of `least`. For nine readings and nine unknowns, the steps do not always find the outlier.
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


def by_accident(far: Mask, q: Array, most: float = MOST) -> bool:
    """True if distant readings (n,), in the order of the table, are few or scattered, and have no separate range
    of any joint. q (n, 6): joint angles in rad. most: largest share."""
    count, share = int(far.sum()), float(far.mean())
    if count > max(1.0, most * len(far)):
        return False
    blocks = int(np.count_nonzero(np.diff(far.astype(int), prepend=0) == 1))
    if share > FEW and blocks < _SCATTERED * count * (1 - share):
        return False
    low, high = q[far].min(axis=0, initial=np.inf), q[far].max(axis=0, initial=-np.inf)
    others = ((q[~far] >= low) & (q[~far] <= high)).any(axis=0)
    return count < _RANGE or bool(others.all())
