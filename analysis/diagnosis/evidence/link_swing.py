"""Vibration of the link, with a new phase in every run: searched in the time of each run instead of the circle angle.

It averages out over repeats, and a fit along the circle cannot detect it. All runs share the frequency. The spectra of
their deviations from the mean of repeats are therefore added, each divided by its noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from analysis.diagnosis.evidence.observation import GRID, STAMP_SCATTER, ObservedRun, Sampling, residual_of
from analysis.robot.kinematics.arm import Array
from analysis.robot.predict import SetUps
from rigs.effects import Effect
from rigs.effects import swing as vibration_at

_LOWEST_HZ = 2.0
"""Lowest frequency searched, in Hz. Chosen: slower motion is servo ripple and path error."""
_NEAR_HZ = 1.0
"""Half width of the neighbourhood with constant spectral noise. Chosen: wide enough for a median."""
_FINER = np.linspace(-0.75, 0.75, 25)
"""Fitted frequencies, in search steps around the largest line, which may be next to the vibration. Chosen: a sixteenth
of a step is 0.01 of a turn from the first to the last lap.
"""
_SEEN = 0.2
"""Minimum share of power visible in the deviations for fitting a combination of vibrations: a part with the same phase
in every lap is invisible. Chosen: with a twentieth, a frequency next to the true one was preferred.
"""


@dataclass(frozen=True)
class FoundVibration:
    """Vibration with parameter uncertainties and log evidence."""

    effect: Effect
    amplitude_mm: float
    sd: dict[str, float]
    gain: float


def find_vibration(runs: Sequence[ObservedRun], setups: SetUps) -> FoundVibration | None:
    """Find the strongest vibration of all circles; None if no circle was repeated.

    The common part of repeats is excluded: gear waves and errors of the path occur at the same angles in every run.
    """
    groups = _repeated(runs, setups)
    deviations = [deviation for group in groups for deviation in group]
    if not deviations:
        return None
    seconds = max(float(np.ptp(deviation.t_s)) for deviation in deviations)
    # There may be a gap between laps, so the median rate is used.
    rate = min(1 / float(np.median(np.diff(deviation.t_s))) for deviation in deviations)
    f = np.arange(_LOWEST_HZ, 0.45 * rate, 0.25 / seconds)
    if len(f) < 2 or len(f) < 2 * (width := int(_NEAR_HZ / (f[1] - f[0]))):
        return None
    from scipy.ndimage import median_filter  # noqa: PLC0415 - slow to import

    power = np.array([_power(deviation, f) for deviation in deviations])
    # Noise around each frequency, from the median, which ignores lines.
    level = median_filter(power, size=(1, 2 * width + 1), mode="reflect") / np.log(2)
    over, count = np.sum(power / level, axis=0), len(deviations)
    k = int(np.argmax(over))
    # Each run has a separate amplitude and phase, so the sum of the powers of n runs has a gamma distribution of shape
    # n.
    gain = float(over[k] - count - count * np.log(max(over[k] / count, 1.0))) - float(np.log(len(f)))
    near = f[k] + (f[1] - f[0]) * _FINER
    tried = [[_fitted(group, frequency_hz) for group in groups] for frequency_hz in near.tolist()]
    at = int(np.argmax([sum(fit.energy for fit in fits) for fits in tried]))
    fits, frequency_hz = tried[at], float(near[at])
    seen = sum(fit.seen for fit in fits)
    noise = float(np.mean(level[:, k])) * sum(fit.spread for fit in fits) / seen
    squares = sum(float(fit.waves.ravel() @ fit.waves.ravel()) for fit in fits) / seen
    amplitude = float(np.sqrt(max(squares - noise, 0.0)))
    # For n runs with independent phases, m combinations are visible: their mean power is that of all times m / n.
    phases = 0.25 * float(np.mean([len(fit.waves) / fit.seen - 1 for fit in fits for _ in fit.waves])) / count
    # Stamps with scatter s reduce a wave of angular frequency w by (w s)²/2.
    scatter_s = np.mean([STAMP_SCATTER * np.median(np.diff(deviation.t_s)) for deviation in deviations])
    lost = float(2 * np.pi * frequency_hz * scatter_s) ** 2 / 2
    sd = float(np.sqrt(noise / 2 / seen + amplitude**2 * (phases + lost**2)))
    sds, amplitude = {"amplitude_mm": sd, "frequency_hz": 0.125 / seconds}, min(amplitude, 1.0)
    return FoundVibration(vibration_at(frequency_hz, amplitude), amplitude, sds, gain)


@dataclass(frozen=True)
class _Deviation:
    """Deviation (n,) mm of a run from the mean of its repeats, averaged over the gauges, at times t_s (n,) s."""

    t_s: Array
    deviation_mm: Array
    sampling: Sampling

    @cached_property
    def quick(self) -> Array:
        slow = np.polynomial.Polynomial.fit(self.t_s, self.deviation_mm, 3)(self.t_s)
        return self.deviation_mm - slow

    def waves(self, frequency_hz: float) -> Array:
        turn = 2 * np.pi * frequency_hz * self.t_s
        return np.stack([np.cos(turn), np.sin(turn)], axis=1)


@dataclass(frozen=True)
class _Fit:
    """Vibration with separate phases in n repeats: cosines and sines `waves` (n, 2) mm, explained energy in mm², number
    of visible run combinations, and sum of the variances of the waves for a noise of 1 mm.
    """

    waves: Array
    energy: float
    seen: float
    spread: float


def _fitted(runs: Sequence[_Deviation], frequency_hz: float) -> _Fit:
    """Fit the vibrations of all repeats. Through the mean, each affects the deviations of all others."""
    count = len(runs)
    # Laps meet the vibration at different phases.
    laps = [deviation.sampling.gridded(deviation.waves(frequency_hz)) / count for deviation in runs]
    normal, right = np.zeros((2 * count, 2 * count)), np.zeros(2 * count)
    for k, deviation in enumerate(runs):
        columns = -np.concatenate([_at_rows(deviation.sampling, lap) for lap in laps], axis=1)
        columns[:, 2 * k : 2 * k + 2] += deviation.waves(frequency_hz)
        normal += columns.T @ columns
        right += columns.T @ deviation.quick
    values, vectors = np.linalg.eigh(normal)
    # A completely visible wave has half the number of readings as its value.
    kept = values > _SEEN * np.mean([len(deviation.t_s) for deviation in runs]) / 2
    along = vectors[:, kept].T @ right
    waves = vectors[:, kept] @ (along / values[kept])
    energy, spread = float(along @ (along / values[kept])), float(np.sum(1 / values[kept]))
    return _Fit(waves.reshape(count, 2), energy, max(int(kept.sum()), 1) / 2, spread)


def _repeated(runs: Sequence[ObservedRun], setups: SetUps) -> list[list[_Deviation]]:
    groups: dict[str, list[ObservedRun]] = {}
    for run in runs:
        if run.sampling:
            groups.setdefault(run.name, []).append(run)
    repeated = []
    for group in groups.values():
        if len(group) < 2:
            continue
        residuals = [residual_of(run, setups).mean(axis=1) for run in group]
        mean = np.mean(
            [run.sampling.gridded(residual) for run, residual in zip(group, residuals, strict=True) if run.sampling],
            axis=0,
        )
        apart = []
        for run, residual in zip(group, residuals, strict=True):
            assert run.sampling is not None  # noqa: S101 - circles only
            rows = run.rows[: len(run.sampling.phi)]
            deviation = residual[: len(rows)] - _at_rows(run.sampling, mean[:, None])[:, 0]
            apart.append(_Deviation(run.path.t_s[rows], deviation, run.sampling))
        repeated.append(apart)
    return repeated


def _at_rows(sampling: Sampling, gridded: Array) -> Array:
    angles = 2 * np.pi * np.arange(GRID) / GRID
    return np.stack([np.interp(sampling.phi, angles, column, period=2 * np.pi) for column in gridded.T], axis=1)


def _power(deviation: _Deviation, f: Array) -> Array:
    """|sum r exp(-i 2 pi f t)|² / n (F,) mm² at the uneven times of the laps."""
    t, r = deviation.t_s, deviation.quick
    # Frequencies are evenly spaced, so each wave is the product of a coarse and a fine wave.
    width = int(np.ceil(np.sqrt(len(f))))
    fine = np.exp(-2j * np.pi * np.outer(t, (f[1] - f[0]) * np.arange(width)))
    coarse = np.exp(-2j * np.pi * np.outer(f[::width], t))
    return np.asarray(np.abs((r * coarse) @ fine).ravel()[: len(f)] ** 2 / len(t), dtype=float)
