"""The noise that stamps make where readings change within milliseconds: while a joint crosses a wide play, a reading
that is stamped a millisecond late is a tenth of a millimetre off.

Elsewhere, stamps that scatter add noise that is alike along the lap, which repeats show. Here a few angles carry a
thousand times as much, which would raise the noise of all orders.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.diagnosis.observed_run import GRID, STAMP_SCATTER, Sampling, by_orders
from analysis.kinematics.arm import Array

_RARE = 5.0
"""How many times the median of a lap the noise of an angle exceeds that is treated by itself. Chosen: the steepest part
of a wave has 1.4 times its median, so that gear errors are left to the noise of the orders; with ten times, the slower
half of a crossing was left to it too."""
_MOST = GRID // 16
"""Largest number of angles of a lap that are treated by themselves, those with most noise. Chosen: beside a play and a
spike of 45 healthy sizes up to 60 angles have such noise, but twice as many columns lower the noise of the orders by a
few per cent only."""
_LEAST_MM = 1e-4
"""Noise in mm below which no angle is treated by itself: a digit of the finest gauges of such a link."""


def stamp_noise(samplings: Sequence[Sampling], t_s: Sequence[Array], readings_mm: Sequence[Array]) -> Array:
    """Return what one standard deviation of the scatter of stamps adds to the entries of a lap, (N, c) mm: a column for
    each angle of the grid at which readings change quickly.

    The readings of the model, (m, 2) mm at times (m,) s for each of some repeated runs, say how quickly; the stamps of
    these runs are taken to scatter alike. The rows of fast gauges are means of many readings and scatter less, but a
    crossing that is shorter than a row makes an error of this size in them too.
    """
    laps = [
        (one, _off_mm(t, readings, len(one.phi)))
        for one, t, readings in zip(samplings, t_s, readings_mm, strict=True)
    ]  # fmt: skip
    sd_mm = np.sqrt(np.mean([one.gridded_sd(off_mm) ** 2 for one, off_mm in laps], axis=0))
    way = np.sign(sum(one.gridded(off_mm) for one, off_mm in laps))
    most = sd_mm.max(axis=1)
    angles = np.argsort(-most)[:_MOST]
    angles = angles[most[angles] > max(_RARE * float(np.median(most)), _LEAST_MM)]
    single = np.zeros((GRID, 2, len(angles)))
    # Both gauges are stamped together.
    single[angles, :, np.arange(len(angles))] = (way * sd_mm)[angles]
    return np.concatenate([by_orders(single), np.zeros((2 * len(samplings[0].stands), len(angles)))])


def _off_mm(t_s: Array, readings_mm: Array, count: int) -> Array:
    """Return by how much the first `count` readings (m, 2) mm are off where stamps are one standard deviation late.

    A step between two readings is as steep for both of them. Readings with the same stamp have no slope.
    """
    steps, passed_s = np.diff(readings_mm[:count], axis=0), np.diff(t_s[:count])[:, None]
    slopes = np.divide(steps, passed_s, out=np.zeros_like(steps), where=passed_s > 0)
    none = np.zeros((1, 2))
    before, after = np.concatenate([none, slopes]), np.concatenate([slopes, none])
    return STAMP_SCATTER * float(np.median(passed_s)) * np.where(np.abs(before) > np.abs(after), before, after)
