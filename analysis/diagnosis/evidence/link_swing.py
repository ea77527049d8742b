"""Vibration of the link, with a new phase in every run: searched in the time of each run instead of the circle angle.

Because of the varying phase, the vibration averages out over repeats, and a fit along the circle cannot detect it. All
runs share the frequency. The spectra of their deviations from the mean of repeats are therefore added, each divided by
its noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from analysis.diagnosis.evidence.observation import GRID, STAMP_SCATTER, ObservedRun, Sampling, residual_of
from analysis.robot.kinematics.arm import Array
from analysis.robot.model.predict import SetUp
from rigs.effects import Effect
from rigs.effects import swing as vibration_at

_LOWEST_HZ = 2.0
"""Lowest frequency searched, in Hz. Chosen: slower motion is servo ripple and path error."""
_NEAR_HZ = 1.0
"""Half width, in Hz, of the neighbourhood with constant spectral noise. Chosen: wide enough for a median over many
frequencies.
"""
_FINER = np.linspace(-0.75, 0.75, 25)
"""Fitted frequencies, in search steps around the largest line. The deviations lack the part common to the laps of
all repeats, so their largest line may be next to the vibration. Chosen: a sixteenth of a step is 0.01 of a turn
from the first to the last lap.
"""
_SEEN = 0.2
"""Minimum share of power visible in the deviations for fitting a combination of vibrations. If every lap meets the
vibration at the same phase, the common part is invisible. Chosen: with a twentieth, a frequency next to the true one
was preferred, because a hardly visible combination absorbed the rest."""

_COMMON_SIGMA = 3.0
"""Significance of the excess of the amplitude of complete runs over that of their deviations. Chosen: as for all
certain results.
"""
_LOST = 0.05
"""Largest relative uncertainty of the amplitude of complete runs caused by scattering stamps and varying phases.
Chosen.
"""
_OTHER_SPEED = 1.1
"""Least ratio of two speeds of the circle that separate a frequency from an error of the path. Chosen: a tenth moves
the frequency of such an error by many widths of a line.
"""


@dataclass(frozen=True)
class FoundVibration:
    """Vibration with parameter uncertainties and log evidence. `scatter_um`: rms contribution, per set-up, to the
    scatter of a run with averaged laps. `may_follow_angle`: whether it has about the same phase in all repeats, and all
    circles have the same speed. An error of the path that follows the angle of the circle then looks the same.
    """

    effect: Effect
    amplitude_mm: float
    sd: dict[str, float]
    gain: float
    scatter_um: dict[str, float]
    may_follow_angle: bool = False


def find_vibration(runs: Sequence[ObservedRun], setups: Mapping[str, SetUp]) -> FoundVibration | None:
    """Return the strongest vibration of all circles; None if no circle was repeated. The residual of a run is (m, 2)
    mm.

    The common part of repeats is excluded: gear waves occur at the same angles in every run, a vibration at different
    times.
    """
    groups = _repeated(runs, setups)
    deviations = [deviation for group in groups for deviation in group.runs]
    if not deviations:
        return None
    seconds = max(float(np.ptp(deviation.t_s)) for deviation in deviations)
    # There may be a gap between laps, so the median rate is used.
    rate = min(1 / float(np.median(np.diff(deviation.t_s))) for deviation in deviations)
    f = np.arange(_LOWEST_HZ, 0.45 * rate, 0.25 / seconds)
    if len(f) < 2 or len(f) < 2 * _width(f):
        return None
    power = np.array([_power(deviation, f) for deviation in deviations])
    level = np.array([_noise_level(spectrum, _width(f)) for spectrum in power])
    over, count = np.sum(power / level, axis=0), len(deviations)
    k = int(np.argmax(over))
    # Each run has a separate amplitude and phase, so the sum of the powers of n runs has a gamma distribution of shape
    # n.
    gain = float(over[k] - count - count * np.log(max(over[k] / count, 1.0))) - float(np.log(len(f)))
    near = f[k] + (f[1] - f[0]) * _FINER
    tried = [[group.fitted(frequency_hz) for group in groups] for frequency_hz in near.tolist()]
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
    scatter: dict[str, list[float]] = {}
    for group, fit in zip(groups, fits, strict=True):
        scatter.setdefault(group.setup, []).append(group.scatter_of(frequency_hz, fit.waves))
    of_deviations = amplitude
    frequency_hz, amplitude, sd = _with_the_common_part(groups, f, frequency_hz, amplitude, sd)
    may_follow_angle = amplitude > of_deviations and _have_one_speed(deviations)
    sds, amplitude = {"amplitude_mm": sd, "frequency_hz": 0.125 / seconds}, min(amplitude, 1.0)
    scatter_um = {setup: 1e3 * float(np.sqrt(np.mean(squares))) for setup, squares in scatter.items()}
    return FoundVibration(vibration_at(frequency_hz, amplitude), amplitude, sds, gain, scatter_um, may_follow_angle)


def _have_one_speed(deviations: Sequence[_Deviation]) -> bool:
    speeds = [abs(float(np.median(np.diff(np.unwrap(run.sampling.phi)) / np.diff(run.t_s)))) for run in deviations]
    return max(speeds) < _OTHER_SPEED * min(speeds)


def _with_the_common_part(
    groups: Sequence[_Repeated], f: Array, frequency_hz: float, amplitude_mm: float, sd_mm: float
) -> tuple[float, float, float]:
    """Return frequency, amplitude and standard uncertainty of a vibration, including the common part of all repeats.

    frequency_hz, amplitude_mm, sd_mm: from the deviations. f (F,): frequencies searched. A vibration synchronous with
    the program has equal phase in every run and is invisible in deviations. Other common parts, such as gear waves,
    have about the same size at adjacent frequencies.
    """
    near = int(np.argmin(np.abs(f - frequency_hz)))
    tried_hz = frequency_hz + (f[1] - f[0]) * _FINER
    squares, noises = np.zeros(len(tried_hz)), []
    wholes = [whole for group in groups for whole in group.wholes]
    for whole in wholes:
        waves = np.exp(-2j * np.pi * np.outer(tried_hz, whole.t_s)) @ whole.quick
        squares += np.abs(2 * waves / len(whole.t_s)) ** 2 / len(wholes)
        noises.append(4 / len(whole.t_s) * float(_noise_level(_power(whole, f), _width(f))[near]))
    noise = float(np.mean(noises))
    whole_mm = float(np.sqrt(max(squares.max() - noise, 0.0)))
    lost = sd_mm / max(amplitude_mm, sd_mm)
    # Repeats share other contributions, so only groups count as independent.
    whole_sd_mm = float(np.hypot(np.sqrt(noise / 2 / len(groups)), min(lost, _LOST) * whole_mm))
    is_common = whole_mm - amplitude_mm > _COMMON_SIGMA * float(np.hypot(sd_mm, whole_sd_mm))
    if not is_common:
        return frequency_hz, amplitude_mm, sd_mm
    return float(tried_hz[np.argmax(squares)]), whole_mm, whole_sd_mm


@dataclass(frozen=True)
class _Deviation:
    """Deviation left_mm (n,) of a run from the mean of its repeats, averaged over the gauges, at times t_s (n,) s."""

    t_s: Array
    left_mm: Array
    sampling: Sampling

    @cached_property
    def quick(self) -> Array:
        """Deviation (n,) mm after removal of slow changes."""
        slow = np.polynomial.Polynomial.fit(self.t_s, self.left_mm, 3)(self.t_s)
        return np.asarray(self.left_mm - slow, dtype=float)

    def waves(self, frequency_hz: float) -> Array:
        """Return cosine and sine (n, 2) of a vibration of 1 mm at the readings, in mm."""
        turn = 2 * np.pi * frequency_hz * self.t_s
        return np.stack([np.cos(turn), np.sin(turn)], axis=1)

    def mean_lap(self, frequency_hz: float) -> Array:
        """Return the mean over laps of cosine and sine of a vibration, (GRID, 2) at the grid.

        Laps meet the vibration at different phases, and the mean has a limited number of angles.
        """
        return self.sampling.gridded(self.waves(frequency_hz))


@dataclass(frozen=True)
class _Repeated:
    """Deviations of n repeated runs in the same set-up. `wholes`: complete residuals instead of deviations from the
    mean.
    """

    setup: str
    runs: tuple[_Deviation, ...]
    wholes: tuple[_Deviation, ...]

    def scatter_of(self, frequency_hz: float, waves: Array) -> float:
        """Return the mean square in mm² added by vibrations with cosines and sines (n, 2) mm to a single run,
        relative to the mean of many.
        """
        laps = np.array(
            [deviation.mean_lap(frequency_hz) @ wave for deviation, wave in zip(self.runs, waves, strict=True)]
        )
        return float(np.mean((laps - laps.mean(axis=0)) ** 2)) * len(laps) / (len(laps) - 1)

    def fitted(self, frequency_hz: float) -> _Fit:
        """Return the vibrations of all repeats. Through the mean, each affects the deviations of all other repeats."""
        count = len(self.runs)
        laps = [deviation.mean_lap(frequency_hz) / count for deviation in self.runs]
        normal, right = np.zeros((2 * count, 2 * count)), np.zeros(2 * count)
        for k, deviation in enumerate(self.runs):
            columns = -np.concatenate([_at_rows(deviation.sampling, lap) for lap in laps], axis=1)
            columns[:, 2 * k : 2 * k + 2] += deviation.waves(frequency_hz)
            normal += columns.T @ columns
            right += columns.T @ deviation.quick
        values, vectors = np.linalg.eigh(normal)
        # A completely visible wave has half the number of readings as its value.
        kept = values > _SEEN * np.mean([len(deviation.t_s) for deviation in self.runs]) / 2
        along = vectors[:, kept].T @ right
        waves = vectors[:, kept] @ (along / values[kept])
        energy, spread = float(along @ (along / values[kept])), float(np.sum(1 / values[kept]))
        return _Fit(waves.reshape(count, 2), energy, max(int(kept.sum()), 1) / 2, spread)


@dataclass(frozen=True)
class _Fit:
    """Vibration with separate phases in n repeats: cosines and sines `waves` (n, 2) mm, explained energy in mm²,
    number of visible run combinations, and sum of the variances of the waves for a noise of 1 mm.
    """

    waves: Array
    energy: float
    seen: float
    spread: float


def _repeated(runs: Sequence[ObservedRun], setups: Mapping[str, SetUp]) -> list[_Repeated]:
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
        apart, wholes = [], []
        for run, residual in zip(group, residuals, strict=True):
            assert run.sampling is not None  # noqa: S101 - circles only
            rows = run.rows[: len(run.sampling.phi)]
            deviation = residual[: len(rows)] - _at_rows(run.sampling, mean[:, None])[:, 0]
            apart.append(_Deviation(run.path.t_s[rows], deviation, run.sampling))
            wholes.append(replace(apart[-1], left_mm=residual[: len(rows)]))
        repeated.append(_Repeated(group[0].setup, tuple(apart), tuple(wholes)))
    return repeated


def _at_rows(sampling: Sampling, gridded: Array) -> Array:
    """Return values at the grid (GRID, k), in any unit, interpolated to the rows of the laps, (n, k)."""
    angles = 2 * np.pi * np.arange(GRID) / GRID
    return np.stack([np.interp(sampling.phi, angles, column, period=2 * np.pi) for column in gridded.T], axis=1)


def _width(f: Array) -> int:
    return int(_NEAR_HZ / (f[1] - f[0]))


def _power(deviation: _Deviation, f: Array) -> Array:
    """Return |sum r exp(-i 2 pi f t)|² / n (F,) mm² at the uneven times of the laps."""
    t, r = deviation.t_s, deviation.quick
    # Frequencies are evenly spaced, so each wave is the product of a coarse and a fine wave.
    width = int(np.ceil(np.sqrt(len(f))))
    fine = np.exp(-2j * np.pi * np.outer(t, (f[1] - f[0]) * np.arange(width)))
    coarse = np.exp(-2j * np.pi * np.outer(f[::width], t))
    return np.asarray(np.abs((r * coarse) @ fine).ravel()[: len(f)] ** 2 / len(t), dtype=float)


def _noise_level(power: Array, width: int) -> Array:
    """Return the mean noise of a spectrum (F,) around each frequency, from the median, which ignores lines."""
    from scipy.ndimage import median_filter  # noqa: PLC0415 - slow to import

    return np.asarray(median_filter(power, size=2 * width + 1, mode="reflect") / np.log(2), dtype=float)
