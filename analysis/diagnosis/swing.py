"""A swing of the link, which begins anew with every run: looked for in the time of each run, not along the circle.

Its phase differs from run to run, so repeats average it out and no fit along the circle sees it. What all runs share is
its frequency: the spectra of what they are off the mean of their repeats, each over its own noise, are added.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.observed import GRID, Seen
from analysis.fitting.observation import residuals_of
from analysis.kinematics.arm import Array
from analysis.model.predict import SetUp
from rigs.effects import Effect
from rigs.effects import swing as swing_of

_LOWEST_HZ = 2.0
_NEAR_HZ = 1.0
"""Half a neighbourhood in which the noise of a spectrum is even."""


@dataclass(frozen=True)
class Swing:
    """A swing found: with the uncertainty of its parameters and the log evidence for it."""

    effect: Effect
    amplitude_mm: float
    sd: dict[str, float]
    gain: float


def swing(runs: Sequence[Seen], setups: Mapping[str, SetUp]) -> Swing | None:
    """The strongest swing of all circles, None where none was repeated.

    What repeats share is not of it: a gear's waves come at the same angles in every run, a swing at its own times.
    """
    left = _apart(runs, setups)
    if not left:
        return None
    seconds = max(float(np.ptp(one.t_s)) for one in left)
    # Between laps there may be a gap: the pace is that of most rows.
    rate = min(1 / float(np.median(np.diff(one.t_s))) for one in left)
    f = np.arange(_LOWEST_HZ, 0.45 * rate, 0.25 / seconds)
    if len(f) < 2 or len(f) < 2 * _width(f):
        return None
    over, squares, noise, count = np.zeros(len(f)), np.zeros(len(f)), [], len(left)
    for one in left:
        power, n = _power(one, f), len(one.t_s)
        level = _level(power, _width(f))
        over += power / level
        squares += 4 * (power - level) / n / one.share
        noise.append(2 * float(np.median(level)) / n / one.share)
    k = int(np.argmax(over))
    # Each run has two unknowns of its own, amplitude and phase: of n runs the sum of powers is a gamma of shape n.
    gain = float(over[k] - count - count * np.log(max(over[k] / count, 1.0))) - float(np.log(len(f)))
    amplitude = float(np.sqrt(max(squares[k] / count, 0.0)))
    # Of a swing of n runs, whose phases are of their own, the mean takes 1/n ± √(1 - 1/n)/n of the power.
    phases = amplitude**2 * float(np.mean([0.25 * (1 - one.share) / one.share for one in left]))
    sd = float(np.sqrt((np.mean(noise) + phases) / count))
    effect = swing_of(float(f[k]), min(amplitude, 1.0))
    return Swing(effect, min(amplitude, 1.0), {"amplitude_mm": sd, "frequency_hz": 0.125 / seconds}, gain)


@dataclass(frozen=True)
class _Apart:
    """What one run is off the mean of its repeats: t_s (n,), left_mm (n,) of the mean of the gauges; share of a swing's
    power that is in it."""

    t_s: Array
    left_mm: Array
    share: float


def _apart(runs: Sequence[Seen], setups: Mapping[str, SetUp]) -> list[_Apart]:
    groups: dict[str, list[Seen]] = {}
    for run in runs:
        if run.sampling:
            groups.setdefault(run.name, []).append(run)
    found = []
    for group in groups.values():
        if len(group) < 2:
            continue
        left = [residuals_of(run.model, [run.one], setups)[0].mean(axis=1) for run in group]
        mean = np.mean(
            [run.sampling.gridded(one) for run, one in zip(group, left, strict=True) if run.sampling], axis=0
        )
        for run, one in zip(group, left, strict=True):
            assert run.sampling is not None  # noqa: S101 - circles only
            phi, rows = run.sampling.phi, run.one.rows[: len(run.sampling.phi)]
            shared = np.interp(phi, 2 * np.pi * np.arange(GRID) / GRID, mean, period=2 * np.pi)
            found.append(_Apart(run.one.path.t_s[rows], one[: len(phi)] - shared, 1 - 1 / len(group)))
    return found


def _width(f: Array) -> int:
    return int(_NEAR_HZ / (f[1] - f[0]))


def _power(one: _Apart, f: Array) -> Array:
    """|sum r exp(-i 2 pi f t)|² / n (F,) mm² at the uneven instants of the laps."""
    t, r = one.t_s, one.left_mm
    r = r - np.polynomial.Polynomial.fit(t, r, 3)(t)
    turn = np.exp(-2j * np.pi * (f[1] - f[0]) * t)
    wave = r * np.exp(-2j * np.pi * f[0] * t)
    found = np.empty(len(f), dtype=complex)
    for k in range(len(f)):
        found[k] = wave.sum()
        wave = wave * turn
    power: Array = np.abs(found) ** 2 / len(t)
    return power


def _level(power: Array, width: int) -> Array:
    """Mean of a spectrum's noise about each frequency: by the median, which a line does not lift."""
    from scipy.ndimage import median_filter  # noqa: PLC0415 - slow to import

    return np.asarray(median_filter(power, size=2 * width + 1, mode="reflect") / np.log(2), dtype=float)
