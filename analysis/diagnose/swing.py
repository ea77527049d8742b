"""A swing of the link, which begins anew with every run: looked for in the time of each run, not along the circle.

Its phase differs from run to run, so repeats average it out and no fit along the circle sees it. What all runs share is
its frequency: their spectra, each over its own noise, are added.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.diagnose.observed import Seen
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
    """The strongest swing of all circles, None where there is no circle to look at."""
    circles = [run for run in runs if run.sampling]
    if not circles:
        return None
    seconds = max(float(np.ptp(run.one.path.t_s)) for run in circles)
    rate = min(len(run.one.path.t_s) / float(np.ptp(run.one.path.t_s)) for run in circles)
    f = np.arange(_LOWEST_HZ, 0.45 * rate, 0.25 / seconds)
    if len(f) < 2 * _width(f):
        return None
    over, squares, count = np.zeros(len(f)), np.zeros(len(f)), 0
    noise = []
    for run in circles:
        power, n = _power(run, setups, f)
        level = _level(power, _width(f))
        over += power / level
        squares += 4 * (power - level) / n
        noise.append(2 * float(np.median(level)) / n)
        count += 1
    k = int(np.argmax(over))
    # Each run has two unknowns of its own, amplitude and phase: of n runs the sum of powers is a gamma of shape n.
    gain = float(over[k] - count - count * np.log(max(over[k] / count, 1.0))) - float(np.log(len(f)))
    amplitude = float(np.sqrt(max(squares[k] / count, 0.0)))
    sd = float(np.sqrt(np.mean(noise) / count))
    effect = swing_of(float(f[k]), min(amplitude, 1.0))
    return Swing(effect, min(amplitude, 1.0), {"amplitude_mm": sd, "frequency_hz": 0.125 / seconds}, gain)


def _width(f: Array) -> int:
    return int(_NEAR_HZ / (f[1] - f[0]))


def _power(run: Seen, setups: Mapping[str, SetUp], f: Array) -> tuple[Array, int]:
    """|sum r exp(-i 2 pi f t)|² / n (F,) mm² of the mean of the gauges, at the uneven instants of the lap."""
    (residual,) = residuals_of(run.model, [run.one], setups)
    assert run.sampling is not None  # noqa: S101 - circles only
    n = len(run.sampling.phi)
    r = residual[:n].mean(axis=1)
    t = run.one.path.t_s[run.one.rows[:n]]
    r = r - np.polynomial.Polynomial.fit(t, r, 3)(t)
    turn = np.exp(-2j * np.pi * (f[1] - f[0]) * t)
    wave = r * np.exp(-2j * np.pi * f[0] * t)
    found = np.empty(len(f), dtype=complex)
    for k in range(len(f)):
        found[k] = wave.sum()
        wave = wave * turn
    return np.abs(found) ** 2 / n, n


def _level(power: Array, width: int) -> Array:
    """Mean of a spectrum's noise about each frequency: by the median, which a line does not lift."""
    from scipy.ndimage import median_filter  # noqa: PLC0415 - slow to import

    return np.asarray(median_filter(power, size=2 * width + 1, mode="reflect") / np.log(2), dtype=float)
