"""A vibration of the link, whose phase is new in every run: it is searched in the time of each run and not along the
circle.

Because its phase differs between runs, repeats average it out and no fit along the circle detects it. All runs share
its frequency, so the spectra of their deviations from the mean of their repeats are added, each divided by its own
noise.
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
"""Lowest frequency in Hz that is searched. Chosen: slower motion is servo ripple and path error."""
_NEAR_HZ = 1.0
"""Half the width of the neighbourhood in which the noise of a spectrum is taken to be constant. Chosen: wide enough for
a median over many frequencies."""
_FINER = np.linspace(-0.75, 0.75, 25)
"""Frequencies that are fitted, in steps of the search about the largest line. The deviations lack what the laps of all
repeats share, so their largest line may be beside the vibration. Chosen: a sixteenth of a step is 0.01 of a turn from
the first to the last lap."""
_SEEN = 0.2
"""Share of its power that the deviations must show of a combination of vibrations of the runs for it to be fitted.
Where every lap meets the vibration at the same phase, they show nothing of what all repeats have in common. Chosen:
with a twentieth, a frequency beside the true one was preferred, where a combination that hardly shows took up the
rest."""

_COMMON_SIGMA = 3.0
"""Standard uncertainties by which the amplitude of whole runs must exceed that of their deviations to count. Chosen: as
for anything that is called certain."""
_LOST = 0.05
"""Largest share of an amplitude that stamps which scatter, and phases that differ, are taken to leave unsure of that of
whole runs, in which no phase cancels another. Chosen."""


@dataclass(frozen=True)
class FoundVibration:
    """A vibration, with the uncertainties of its parameters and the log evidence for it. `scatter_um` is the root mean
    square that it adds, in each set-up, to the scatter of one run, in which the laps are averaged."""

    effect: Effect
    amplitude_mm: float
    sd: dict[str, float]
    gain: float
    scatter_um: dict[str, float]


def find_vibration(runs: Sequence[ObservedRun], setups: Mapping[str, SetUp]) -> FoundVibration | None:
    """Return the strongest vibration of all circles, or None where no circle was repeated; the residual of a run is (m,
    2) mm.

    It excludes what repeats share: the waves of a gear occur at the same angles in every run, a vibration at other
    times.
    """
    groups = _repeated(runs, setups)
    deviations = [deviation for group in groups for deviation in group.runs]
    if not deviations:
        return None
    seconds = max(float(np.ptp(deviation.t_s)) for deviation in deviations)
    # There may be a gap between laps, so the rate is that of most rows.
    rate = min(1 / float(np.median(np.diff(deviation.t_s))) for deviation in deviations)
    f = np.arange(_LOWEST_HZ, 0.45 * rate, 0.25 / seconds)
    if len(f) < 2 or len(f) < 2 * _width(f):
        return None
    power = np.array([_power(deviation, f) for deviation in deviations])
    level = np.array([_noise_level(spectrum, _width(f)) for spectrum in power])
    over, count = np.sum(power / level, axis=0), len(deviations)
    k = int(np.argmax(over))
    # Each run has its own amplitude and phase, so the sum of the powers of n runs has a gamma distribution of shape n.
    gain = float(over[k] - count - count * np.log(max(over[k] / count, 1.0))) - float(np.log(len(f)))
    near = f[k] + (f[1] - f[0]) * _FINER
    tried = [[group.fitted(frequency_hz) for group in groups] for frequency_hz in near.tolist()]
    at = int(np.argmax([sum(fit.energy for fit in fits) for fits in tried]))
    fits, frequency_hz = tried[at], float(near[at])
    seen = sum(fit.seen for fit in fits)
    noise = float(np.mean(level[:, k])) * sum(fit.spread for fit in fits) / seen
    squares = sum(float(fit.waves.ravel() @ fit.waves.ravel()) for fit in fits) / seen
    amplitude = float(np.sqrt(max(squares - noise, 0.0)))
    # Of n runs with independent phases, m combinations are seen: their power is that of all times m / n, on average.
    phases = 0.25 * float(np.mean([len(fit.waves) / fit.seen - 1 for fit in fits for _ in fit.waves])) / count
    # Stamps that scatter by s make a wave of angular frequency w smaller by (w s)²/2.
    scatter_s = np.mean([STAMP_SCATTER * np.median(np.diff(deviation.t_s)) for deviation in deviations])
    lost = float(2 * np.pi * frequency_hz * scatter_s) ** 2 / 2
    sd = float(np.sqrt(noise / 2 / seen + amplitude**2 * (phases + lost**2)))
    scatter: dict[str, list[float]] = {}
    for group, fit in zip(groups, fits, strict=True):
        scatter.setdefault(group.setup, []).append(group.scatter_of(frequency_hz, fit.waves))
    frequency_hz, amplitude, sd = _with_the_common_part(groups, f, frequency_hz, amplitude, sd)
    sds, amplitude = {"amplitude_mm": sd, "frequency_hz": 0.125 / seconds}, min(amplitude, 1.0)
    scatter_um = {setup: 1e3 * float(np.sqrt(np.mean(squares))) for setup, squares in scatter.items()}
    return FoundVibration(vibration_at(frequency_hz, amplitude), amplitude, sds, gain, scatter_um)


def _with_the_common_part(
    groups: Sequence[_Repeated], f: Array, frequency_hz: float, amplitude_mm: float, sd_mm: float
) -> tuple[float, float, float]:
    """Return frequency, amplitude and its standard uncertainty of a vibration, with what all repeats have in common at
    its frequency, given those of their deviations and the frequencies f (F,) that were searched.

    A vibration that begins with the program has the same phase in every run, which no deviation shows. What repeats of
    the circle have there anyway, as waves of gears, is about as large at the frequencies beside it.
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
    # Repeats share what is no vibration, so that only groups count as independent.
    whole_sd_mm = float(np.hypot(np.sqrt(noise / 2 / len(groups)), min(lost, _LOST) * whole_mm))
    is_common = whole_mm - amplitude_mm > _COMMON_SIGMA * float(np.hypot(sd_mm, whole_sd_mm))
    if not is_common:
        return frequency_hz, amplitude_mm, sd_mm
    return float(tried_hz[np.argmax(squares)]), whole_mm, whole_sd_mm


@dataclass(frozen=True)
class _Deviation:
    """The deviation left_mm (n,) of one run from the mean of its repeats, averaged over the gauges, at times t_s
    (n,)."""

    t_s: Array
    left_mm: Array
    sampling: Sampling

    @cached_property
    def quick(self) -> Array:
        """The deviation (n,) mm without what changes slowly."""
        slow = np.polynomial.Polynomial.fit(self.t_s, self.left_mm, 3)(self.t_s)
        return np.asarray(self.left_mm - slow, dtype=float)

    def waves(self, frequency_hz: float) -> Array:
        """Return the cosine and the sine (n, 2) of a vibration of 1 mm at the readings, in mm."""
        turn = 2 * np.pi * frequency_hz * self.t_s
        return np.stack([np.cos(turn), np.sin(turn)], axis=1)

    def mean_lap(self, frequency_hz: float) -> Array:
        """Return what the mean of the laps contains of the cosine and the sine of a vibration, (GRID, 2) at the grid.
        The laps meet it at phases of their own, and the mean has a limited number of angles."""
        return self.sampling.gridded(self.waves(frequency_hz))


@dataclass(frozen=True)
class _Repeated:
    """The deviations of runs that repeat each other, n of them, in one set-up; `wholes` are not the deviations from
    their mean, but all that the model leaves of each."""

    setup: str
    runs: tuple[_Deviation, ...]
    wholes: tuple[_Deviation, ...]

    def scatter_of(self, frequency_hz: float, waves: Array) -> float:
        """Return the mean square in mm² that vibrations with cosines and sines (n, 2) mm add to one run, compared with
        the mean of many."""
        laps = np.array(
            [deviation.mean_lap(frequency_hz) @ wave for deviation, wave in zip(self.runs, waves, strict=True)]
        )
        return float(np.mean((laps - laps.mean(axis=0)) ** 2)) * len(laps) / (len(laps) - 1)

    def fitted(self, frequency_hz: float) -> _Fit:
        """Return the vibrations of all repeats. Each is in the deviation of every other one through the mean."""
        count = len(self.runs)
        laps = [deviation.mean_lap(frequency_hz) / count for deviation in self.runs]
        normal, right = np.zeros((2 * count, 2 * count)), np.zeros(2 * count)
        for k, deviation in enumerate(self.runs):
            columns = -np.concatenate([_at_rows(deviation.sampling, lap) for lap in laps], axis=1)
            columns[:, 2 * k : 2 * k + 2] += deviation.waves(frequency_hz)
            normal += columns.T @ columns
            right += columns.T @ deviation.quick
        values, vectors = np.linalg.eigh(normal)
        # A wave that is seen entirely has half the number of readings as its value.
        kept = values > _SEEN * np.mean([len(deviation.t_s) for deviation in self.runs]) / 2
        along = vectors[:, kept].T @ right
        waves = vectors[:, kept] @ (along / values[kept])
        energy, spread = float(along @ (along / values[kept])), float(np.sum(1 / values[kept]))
        return _Fit(waves.reshape(count, 2), energy, max(int(kept.sum()), 1) / 2, spread)


@dataclass(frozen=True)
class _Fit:
    """A vibration with a phase of its own in each of n repeats: their cosines and sines `waves` (n, 2) mm, the energy
    in mm² that they explain, the number of combinations of runs that the deviations show, and the sum of the variances
    of the waves for a noise of 1 mm."""

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
    """Return values at the grid (GRID, k), in any unit, at the rows of the laps, (n, k)."""
    angles = 2 * np.pi * np.arange(GRID) / GRID
    return np.stack([np.interp(sampling.phi, angles, column, period=2 * np.pi) for column in gridded.T], axis=1)


def _width(f: Array) -> int:
    return int(_NEAR_HZ / (f[1] - f[0]))


def _power(deviation: _Deviation, f: Array) -> Array:
    """Return |sum r exp(-i 2 pi f t)|² / n (F,) mm² at the uneven instants of the laps."""
    t, r = deviation.t_s, deviation.quick
    # Frequencies are evenly spaced, so each wave is the product of a coarse one and a fine one.
    width = int(np.ceil(np.sqrt(len(f))))
    fine = np.exp(-2j * np.pi * np.outer(t, (f[1] - f[0]) * np.arange(width)))
    coarse = np.exp(-2j * np.pi * np.outer(f[::width], t))
    return np.asarray(np.abs((r * coarse) @ fine).ravel()[: len(f)] ** 2 / len(t), dtype=float)


def _noise_level(power: Array, width: int) -> Array:
    """Return the mean noise of a spectrum (F,) about each frequency, from the median, which a line does not raise."""
    from scipy.ndimage import median_filter  # noqa: PLC0415 - slow to import

    return np.asarray(median_filter(power, size=2 * width + 1, mode="reflect") / np.log(2), dtype=float)
