"""Changes between the laps of a run: slow drift, which causes a ramp along each lap, and slips of a clamp.

A drift continues all the time, and a slip happens once. The difference of two laps is constant around the circle for a
drift, and has a step for a slip. Both are removed as far as the laps show the changes.
"""

from __future__ import annotations

import numpy as np

from analysis.robot.kinematics.arm import Array
from analysis.runs.noise.cell_noise import DRIFT_MM_PER_S
from analysis.runs.noise.readings import Mask, beyond_neighbours
from analysis.runs.noise.spectrum import NODES, ORDERS

_WIDE = (24, 8)
"""Nodes on either side of a step over which it is detected: 12°, and 4° near the ends of a lap. In 200 simulated
pairs of laps with the noise of real cells there was no false slip at this, half or twice the width. Of 200 slips
of 8 standard deviations of the slow noise 26 were found, 52 at half the width and 28 at twice."""
_CLEAR = 8.0
"""Size of a step, in robust standard deviations of all such differences, from which it is a slip. 700 positions are
tested, and the differences have heavy tails. In the same laps limits of 6 and 10 give no false slip either, and
find 104 and 5 slips."""
_SLIPPED = 4.0
"""Difference of the levels of two laps, in standard deviations, from which it is a slip. Chosen: noise exceeds 4
sigma only in 1 of 16 000 cases."""
_RINGS = 6
"""Number of nodes on either side of a burst of outliers that are replaced too.

The fitted polyline changes beyond them by less than a thousandth.
"""
_LEVEL = 120
"""Nodes on either side of a step for averaging the level: 60°. Chosen: several correlation lengths of slow noise."""
_NEAR = 41
"""Number of nodes around a node for the detection of a burst of outliers: 20°. Chosen: longer than a burst."""


def without_slips(laps: Array) -> tuple[Array, list[float]]:
    """Laps (L, NODES) of a gauge in order of time, corrected for the steps of its clamp, and these steps."""
    slips: list[float] = []
    while len(slips) < len(laps) and (clearest := _clearest(laps)):
        lap, node, step = clearest
        between = laps[lap + 1] - laps[lap]
        before = float(np.median(between[max(0, node - _LEVEL) : node]))
        after = float(np.median(between[node : node + _LEVEL]))
        laps = laps.copy()
        if abs(before) < abs(after):  # The laps agreed until here, so the later lap slipped.
            lap, by = lap + 1, step
        else:
            by = -step
        laps[lap, node:] -= by
        laps[lap + 1 :] -= by
        slips.append(by)
    return laps, slips


def _clearest(laps: Array) -> tuple[int, int, float] | None:
    """Lap, node and size of the clearest step between a lap and the next, or None if no step is clear."""
    clearest: tuple[int, int, float] | None = None
    most = _CLEAR
    for lap, between in enumerate(np.diff(laps, axis=0)):
        for width in _WIDE:
            level = np.median(np.lib.stride_tricks.sliding_window_view(between, width), axis=1)
            steps = level[width:] - level[:-width]
            away = np.abs(steps - np.median(steps))
            # Most differences of coarse readings are zero, but not the ninetieth percentile.
            spread = max(1.4826 * float(np.median(away)), float(np.quantile(away, 0.9)) / 1.645, 1e-12)
            if width < _WIDE[0]:
                steps[_WIDE[0] - width : width - _WIDE[0]] = 0.0
            place = int(np.argmax(np.abs(steps)))
            clear = abs(float(steps[place])) / spread
            node, step = place + width, float(steps[place])
            if not clear > most:
                continue
            before, after = between[max(0, node - _LEVEL) : node], between[node : node + _LEVEL]
            if 0.5 < (float(np.median(after)) - float(np.median(before))) / step < 2.0:  # The level remains changed.
                most, clearest = clear, (lap, node, step)
    return clearest


def bursts(laps: Array) -> Mask:
    """Mask (L, NODES) of nodes at which a lap differs both from its neighbours and from the other laps.

    Such bursts are outliers in succession, too many for a running median. The neighbourhood is wide, because a line
    through outliers oscillates.
    """
    odd = np.zeros(laps.shape, dtype=bool)
    for lap in range(len(laps) if len(laps) > 1 else 0):
        others = np.delete(laps, lap, axis=0).mean(axis=0)
        apart = laps[lap] - others
        leaves = np.abs(apart - _local_median(apart))
        # If the curve jumps, laps also differ because their rows are at slightly different angles.
        bad = beyond_neighbours(leaves) & (leaves > changes(others))
        bad &= np.abs(laps[lap] - _local_median(laps[lap])) > np.abs(others - _local_median(others))
        if bad.any():
            wide = np.any([np.roll(bad, by) for by in range(-_RINGS, _RINGS + 1)], axis=0)
            odd[lap] = wide if wide.sum() < NODES // 4 else False
    return odd


def following(laps: Array, odd: Mask) -> Array:
    """Laps (L, NODES) with masked values replaced by the other laps.

    odd (L, NODES): mask of the values to replace. The distance of the new values from the other laps is that of the
    surrounding nodes.
    """
    mended = laps.copy()
    for lap in np.flatnonzero(odd.any(axis=1)):
        others = np.delete(laps, lap, axis=0).mean(axis=0)
        good = np.flatnonzero(~odd[lap])
        apart = np.interp(np.flatnonzero(odd[lap]), good, (laps[lap] - others)[good], period=NODES)
        mended[lap, odd[lap]] = others[odd[lap]] + apart
    return mended


def without_level_steps(laps: Array, level_sd: float, apart_s: float, per_mm: float) -> tuple[Array, list[float]]:
    """Laps (L, NODES) shifted to the level of the first lap, and the steps removed.

    A step between the levels of two laps is removed if it exceeds noise and drift, as after a slip on the way back.
    level_sd: standard deviation of the level of a lap by noise.
    """
    steps = np.diff(laps.mean(axis=1))
    # Two gauges may drift in opposite directions, each by the largest drift of real cells.
    limit = np.sqrt(2) * DRIFT_MM_PER_S * per_mm * apart_s + _SLIPPED * np.sqrt(2) * level_sd
    slips = np.where(np.abs(steps) > limit, steps, 0.0)
    level: Array = laps - np.concatenate([[0.0], np.cumsum(slips)])[:, None]
    return level, slips[slips != 0].tolist()


def changes(lap: Array) -> Array:
    """Change (NODES,) of a lap within two nodes, excluding the sine and the second order."""
    spectrum = np.fft.rfft(lap)
    spectrum[:3] = 0.0
    rough = np.fft.irfft(spectrum, NODES)
    changes: Array = np.max([np.abs(np.roll(rough, reach) - rough) for reach in (-2, -1, 1, 2)], axis=0)
    return changes


def _local_median(values: Array) -> Array:
    """Median (NODES,) of the nodes around each node, cyclic along the lap."""
    half = _NEAR // 2
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(values, half, mode="wrap"), _NEAR)
    median: Array = np.median(windows, axis=1)
    return median


def without_drift(
    laps: Array, level_variance: float, times_s: tuple[float, float], per_mm: float
) -> tuple[Array, float, float]:
    """Laps (L, NODES) with the ramp of their means removed, the drift in a lap, and the variance of the drift.

    times_s: duration of a lap, and time between the starts of two laps. level_variance: noise of the mean of a lap. The
    ramp is shrunk towards the largest drift of real cells. With noisy levels or a single lap it cannot be detected, and
    all of it is uncertainty.
    """
    lap_s, apart_s = times_s
    plausible = (DRIFT_MM_PER_S * lap_s * per_mm) ** 2 / 3
    if len(laps) == 1:
        return laps, 0.0, plausible
    number = np.arange(len(laps)) - (len(laps) - 1) / 2
    leverage = float(number @ number) * (apart_s / lap_s) ** 2
    seen = float(number @ laps.mean(axis=1)) * (apart_s / lap_s) / leverage
    noise = level_variance / leverage
    drift = seen * plausible / (plausible + noise)
    since = np.arange(NODES) / NODES - 0.5 + number[:, None] * (apart_s / lap_s)
    return laps - drift * since, drift, plausible * noise / (plausible + noise)


def power_of_ramp(variance: float) -> Array:
    """Mean square (NODES // 2 + 1,), in mm², of the Fourier coefficients of a ramp along each lap with a
    variance in mm²."""
    power = np.zeros(len(ORDERS))
    power[1:] = variance / (2 * np.pi * ORDERS[1:]) ** 2
    return power
