"""The noise that stamps make where readings change within milliseconds: while a joint crosses a wide play, a reading
that is stamped a millisecond late is a tenth of a millimetre off.

Elsewhere, stamps that scatter add noise that is alike along the lap, which repeats show. Here a few angles carry a
thousand times as much, which would raise the noise of all orders.
"""

from __future__ import annotations

import numpy as np

from analysis.diagnosis.observed_run import GRID, STAMP_SCATTER, Sampling, by_orders
from analysis.kinematics.arm import Array

_RARE = 10.0
"""How many times the median of a lap the noise of an angle exceeds that is treated by itself. Chosen: the steepest part
of a wave has 1.4 times its median, so that gear errors are left to the noise of the orders."""
_MOST = GRID // 16
"""Largest number of angles of a lap that are treated by themselves, those with most noise. Chosen: four reversals of
eight angles each."""
_LEAST_MM = 1e-4
"""Noise in mm below which no angle is treated by itself: a digit of the finest gauges of such a link."""


def stamp_noise(sampling: Sampling, t_s: Array, readings_mm: Array) -> Array:
    """Return what one standard deviation of the scatter of stamps adds to the entries of a lap, (N, c) mm: a column for
    each angle of the grid at which readings (m, 2) mm of the model at times t_s (m,) change quickly."""
    count = len(sampling.phi)
    t_s, readings_mm = t_s[:count], readings_mm[:count]
    moment_s = STAMP_SCATTER * float(np.median(np.diff(t_s)))
    off_mm = moment_s * np.gradient(readings_mm, t_s, axis=0)
    sd_mm = sampling.gridded_sd(off_mm)
    most = sd_mm.max(axis=1)
    angles = np.argsort(-most)[:_MOST]
    angles = angles[most[angles] > max(_RARE * float(np.median(most)), _LEAST_MM)]
    single = np.zeros((GRID, 2, len(angles)))
    # Both gauges are stamped together.
    single[angles, :, np.arange(len(angles))] = (np.sign(sampling.gridded(off_mm)) * sd_mm)[angles]
    return np.concatenate([by_orders(single), np.zeros((2 * len(sampling.stands), len(angles)))])


def without_stamp_noise(values: Array, stamps: Array) -> Array:
    """Return entries (…, N) mm without what stamps (N, c) mm could explain, and the rest scaled to its original
    variance."""
    if not stamps.shape[1]:
        return values
    span, _ = np.linalg.qr(stamps)
    free = 1 - (span**2).sum(axis=1)
    own: Array = (values - (values @ span) @ span.T) / np.sqrt(free)
    return own
