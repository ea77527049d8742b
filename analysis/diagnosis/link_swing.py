"""A vibration of the link, whose phase is new in every run: it is searched in the time of each run and not along the
circle.

Because its phase differs between runs, repeats average it out and no fit along the circle detects it. All runs share
its frequency, so the spectra of their deviations from the mean of their repeats are added, each divided by its own
noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.observed_run import GRID, STAMP_SCATTER, ObservedRun, Sampling
from analysis.fitting.observation import residuals_of
from analysis.kinematics.arm import Array
from analysis.model.predict import SetUp
from rigs.effects import Effect
from rigs.effects import swing as vibration_at

_LOWEST_HZ = 2.0
"""Lowest frequency in Hz that is searched. Chosen: slower motion is servo ripple and path error."""
_NEAR_HZ = 1.0
"""Half the width of the neighbourhood in which the noise of a spectrum is taken to be constant. Chosen: wide enough for
a median over many frequencies."""
_FINER = 17
"""Frequencies between two of the search, among which the largest line is. Chosen: laps then meet a vibration at phases
that are known within 0.01 of a turn."""


@dataclass(frozen=True)
class FoundVibration:
    """A vibration, with the uncertainties of its parameters and the log evidence for it. `scatter_um` is the root mean
    square that it adds to the scatter of one run, in which the laps are averaged."""

    effect: Effect
    amplitude_mm: float
    sd: dict[str, float]
    gain: float
    scatter_um: float = 0.0


def find_vibration(runs: Sequence[ObservedRun], setups: Mapping[str, SetUp]) -> FoundVibration | None:
    """Return the strongest vibration of all circles, or None where no circle was repeated; the residual of a run is (m,
    2) mm.

    It excludes what repeats share: the waves of a gear occur at the same angles in every run, a vibration at other
    times.
    """
    left = _deviations(runs, setups)
    if not left:
        return None
    seconds = max(float(np.ptp(one.t_s)) for one in left)
    # There may be a gap between laps, so the rate is that of most rows.
    rate = min(1 / float(np.median(np.diff(one.t_s))) for one in left)
    f = np.arange(_LOWEST_HZ, 0.45 * rate, 0.25 / seconds)
    if len(f) < 2 or len(f) < 2 * _width(f):
        return None
    power = np.array([_power(one, f) for one in left])
    level = np.array([_noise_level(one, _width(f)) for one in power])
    over, count = np.sum(power / level, axis=0), len(left)
    k = int(np.argmax(over))
    # Each run has its own amplitude and phase, so the sum of the powers of n runs has a gamma distribution of shape n.
    gain = float(over[k] - count - count * np.log(max(over[k] / count, 1.0))) - float(np.log(len(f)))
    near = f[k] + (f[1] - f[0]) * np.linspace(-0.5, 0.5, _FINER)
    of_line = np.array([_power(one, near) for one in left])
    at = int(np.argmax(np.sum(of_line / level[:, [k]], axis=0)))
    frequency_hz = float(near[at])
    share = np.array([one.share_of(frequency_hz) for one in left])
    each = 1 / np.array([len(one.t_s) for one in left]) / share
    amplitude = float(np.sqrt(max(np.mean(4 * (of_line[:, at] - level[:, k]) * each), 0.0)))
    # The mean of n runs with independent phases contains 1/n ± √(1 - 1/n)/n of the power of a vibration.
    phases = amplitude**2 * np.mean(0.25 * (1 - share) / share)
    # Stamps that scatter by s make a wave of angular frequency w smaller by (w s)²/2.
    scatter_s = [STAMP_SCATTER * np.median(np.diff(one.t_s)) for one in left]
    lost = amplitude * (2 * np.pi * frequency_hz * np.mean(scatter_s)) ** 2 / 2
    noise = np.mean(2 * np.median(level, axis=1) * each)
    sd = float(np.sqrt((noise + phases) / count + lost**2))
    effect = vibration_at(frequency_hz, min(amplitude, 1.0))
    sds = {"amplitude_mm": sd, "frequency_hz": 0.125 / seconds}
    of_laps = np.mean([np.mean(np.abs(one.mean_lap(frequency_hz)) ** 2) for one in left])
    scatter_um = 1e3 * amplitude * float(np.sqrt(of_laps / 2))
    return FoundVibration(effect, min(amplitude, 1.0), sds, gain, scatter_um)


@dataclass(frozen=True)
class _Deviation:
    """The deviation left_mm (n,) of one run from the mean of its `count` repeats, averaged over the gauges, at times
    t_s (n,)."""

    t_s: Array
    left_mm: Array
    sampling: Sampling
    count: int

    def mean_lap(self, frequency_hz: float) -> Array:
        """Return what the mean of the laps of one run contains of a vibration exp(i 2 pi f t): (GRID,) at the grid. The
        laps meet it at phases of their own, and the mean has a limited number of angles."""
        return self.sampling.gridded(np.exp(2j * np.pi * frequency_hz * self.t_s))

    def share_of(self, frequency_hz: float) -> float:
        """Return the share of a vibration's power that the deviation contains, where each run has a phase of its
        own."""
        wave = np.exp(2j * np.pi * frequency_hz * self.t_s)
        shared = _at_rows(self.sampling, self.mean_lap(frequency_hz))
        taken = abs(np.mean(wave.conj() * shared)) / self.count
        return float((1 - taken) ** 2 + (self.count - 1) * taken**2)


def _deviations(runs: Sequence[ObservedRun], setups: Mapping[str, SetUp]) -> list[_Deviation]:
    groups: dict[str, list[ObservedRun]] = {}
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
            rows = run.one.rows[: len(run.sampling.phi)]
            apart = one[: len(rows)] - _at_rows(run.sampling, mean)
            found.append(_Deviation(run.one.path.t_s[rows], apart, run.sampling, len(group)))
    return found


def _at_rows(sampling: Sampling, gridded: Array) -> Array:
    """Return values at the grid (GRID,), in any unit, at the rows of the laps, (n,)."""
    at: Array = np.interp(sampling.phi, 2 * np.pi * np.arange(GRID) / GRID, gridded, period=2 * np.pi)
    return at


def _width(f: Array) -> int:
    return int(_NEAR_HZ / (f[1] - f[0]))


def _power(one: _Deviation, f: Array) -> Array:
    """Return |sum r exp(-i 2 pi f t)|² / n (F,) mm² at the uneven instants of the laps."""
    t, r = one.t_s, one.left_mm
    r = r - np.polynomial.Polynomial.fit(t, r, 3)(t)
    # Frequencies are evenly spaced, so each wave is the product of a coarse one and a fine one.
    width = int(np.ceil(np.sqrt(len(f))))
    fine = np.exp(-2j * np.pi * np.outer(t, (f[1] - f[0]) * np.arange(width)))
    coarse = np.exp(-2j * np.pi * np.outer(f[::width], t))
    power: Array = np.abs((r * coarse) @ fine).ravel()[: len(f)] ** 2 / len(t)
    return power


def _noise_level(power: Array, width: int) -> Array:
    """Return the mean noise of a spectrum (F,) about each frequency, from the median, which a line does not raise."""
    from scipy.ndimage import median_filter  # noqa: PLC0415 - slow to import

    return np.asarray(median_filter(power, size=2 * width + 1, mode="reflect") / np.log(2), dtype=float)
