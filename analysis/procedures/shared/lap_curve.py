"""A closed curve over circle angle: the mean of the laps that were driven, with what noise may have added to it.

Every figure and every Monte Carlo draw (JCGM 101) is of 720 numbers. Figures are those of the curve at a stated angular
resolution, as in the roundness of ISO 12181-2: a Gaussian filter that passes half of 80 undulations per revolution (a
wavelength of 4.5°). The range of a noisy curve without one has no true value.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.procedures.shared.quantity import PLACE, Quantity, figures_of
from analysis.procedures.shared.reduction import Reduced
from analysis.robot.kinematics.arm import Array
from analysis.runs.noise.cell_noise import least_known
from analysis.runs.noise.lap_changes import power_of_ramp, without_drift, without_level_steps
from analysis.runs.noise.readings import rounding_error
from analysis.runs.noise.spectrum import DRAWS, NODES, ORDERS, LapNoise, noise_of

SEED = 0
"""Fixed, so that the same run gives the same report."""
UNDULATIONS = 80.0
"""Per revolution, of which half pass: ISO 12181-2 has 15, 50, 150 and 500 for roundness; robots' gears have orders up
to some 60, and their reversals transits of a degree and more."""
_PASSES = 0.5 ** ((ORDERS / UNDULATIONS) ** 2)
_COARSE = 0.5 ** ((ORDERS / 40.0) ** 2)
"""Smooths away the stairs that rounding makes, so that other stairs can be tried."""
_WINDOW = 21
"""Nodes of the running median: 10°, less than lies between most reversals."""
_LOCAL, _SLOW = 19, 81
"""Nodes within which laps are compared, twice the stated resolution, less what they differ by within 40°."""
_ODD, _MOST = 2.0, 5.0
"""Laps that differ by so many times the usual differ for another reason than noise; and how far Student's law with one
degree of freedom is followed."""
_FEWEST = 8.0
"""Readings of a lap, of a gauge that hardly moves by a step: it shows no jumps."""
RANGE_U = 0.5
"""Share of the correction for noise by which a range is uncertain: the curve without noise is itself an estimate."""

Plain = Callable[[Array], Mapping[str, Array]]
"""The plain figures (...,) by name of curves (..., NODES)."""


@dataclass(frozen=True)
class LapCurve:
    """A curve y (NODES,) over PHI, and errors (DRAWS, NODES) that noise may have put into it; power (NODES // 2 + 1,):
    likely mean square of these in each order; laps (L, NODES) that y is the mean of; drift: of a lap; rate: rad/s of
    phi; blur: of a row's place, rad; slips: steps of the level between laps, taken out; again: the same curve made
    again, which draws the same errors."""

    y: Array
    again: Callable[[], LapCurve]
    power: Array
    laps: Array
    noise: LapNoise
    drift: float
    rate: float
    blur: float
    slips: tuple[float, ...]

    @cached_property
    def errors(self) -> Array:
        """The errors (DRAWS, NODES): 2.3 MB, which are neither sent from process to process nor kept with a result."""
        return self.again().errors

    @property
    def without_draws(self) -> LapCurve:
        """The same curve, which draws its errors again where they are asked for."""
        return replace(self)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "errors"}

    @property
    def calm(self) -> Array:
        """y (NODES,) with its noise reduced."""
        return calmed(self.y, self.power)

    def turned(self, lag_s: Array) -> NDArray[np.complex128]:
        """What lag_s (DRAWS,) of the gauges makes of each order, (DRAWS, NODES // 2 + 1)."""
        factors: NDArray[np.complex128] = np.exp(-1j * ORDERS * self.rate * lag_s[:, None])
        return factors

    def drawn(self, curve: Array, turned: NDArray[np.complex128], scale: Array) -> Array:
        """A curve (NODES,), this one or its calm, as runs with other noise, lag (`turned`) and relative scale (DRAWS,)
        might have shown it: (DRAWS, NODES)."""
        return np.fft.irfft(np.fft.rfft(curve) * turned, NODES, axis=1) / scale[:, None] + self.errors


def curve_of(
    run: Reduced, values: Callable[[Array], Array], per_mm: float, channel: int = 0, like: LapNoise | None = None
) -> LapCurve:
    """The curve of `values`, which makes (...,) of readings (..., k) mm, and per_mm of a gauge's noise; like: the noise
    of another run of the cell, where this one has a single lap."""
    # The draws of two directions, and of angle and distance, have nothing to do with each other.
    rng = np.random.default_rng((SEED, channel, int(run.rate > 0)))
    laps = values(run.g_mm)
    borrowed = like is not None and len(laps) == 1
    noise = (
        like.elsewhere(rng) if borrowed and like else noise_of(laps, run.rows, (run.lap_s, run.apart_s), per_mm, rng)
    )
    levels = noise.power(1, run.rows, run.lap_s)[:, 0]
    laps, slips = without_level_steps(laps, float(np.sqrt(np.median(levels))), run.apart_s, per_mm)
    level = float(levels.mean())
    laps, drift, variance = without_drift(laps, level, (run.lap_s, run.apart_s), per_mm)
    power = noise.power(len(laps), run.rows, run.lap_s) + power_of_ramp(variance)
    # It is unknown which of two levels is the right one.
    power[:, 0] += float(np.square(slips).sum()) / 4
    # The level is that of the run's middle; when it began, with the gauges at zero, it was half the drift away.
    power[:, 0] += (drift**2 + variance) * (len(laps) * run.apart_s / run.lap_s) ** 2 / 4
    parts = rng.standard_normal((2, *power.shape)) * np.sqrt(power / 2)
    spectra = parts[0] + 1j * parts[1]
    spectra[:, 0] = np.sqrt(2) * parts[0][:, 0]
    mean = run.g_mm.mean(axis=0)
    errors: Array = (
        np.fft.irfft(spectra, NODES, axis=1) * NODES
        + values(mean + _stairs(run, rng) + _misplaced(run, rng))
        - values(mean)
    )
    errors += _where_laps_differ(laps, rng)
    place = np.argsort(run.order)
    likely = np.exp(np.log(power).mean(axis=0))
    curve = LapCurve(
        laps.mean(axis=0)[place],
        partial(curve_of, run, values, per_mm, channel, like),
        likely,
        laps[:, place],
        noise,
        drift,
        run.rate,
        run.blur,
        tuple(slips),
    )
    vars(curve)["errors"] = errors[:, place]
    return curve


def at_resolution(y: Array) -> Array:
    """Curves (..., NODES), in any unit, at the stated angular resolution."""
    return np.asarray(np.fft.irfft(np.fft.rfft(y) * _PASSES, NODES))


def figures(
    plain: Plain,
    curves: Sequence[LapCurve],
    drawn: Callable[[Sequence[Array]], Sequence[Array]],
    samples: int,
    ranges: frozenset[str],
    calm: Sequence[Array] | None = None,
) -> dict[str, Quantity]:
    """Figures by name of some curves together: `plain` takes them stacked, (curves, ..., NODES).

    drawn: the draws (DRAWS, NODES) of each about the curves that it is given. A range is lowered by the
    median of what noise adds to that of the calm curve, never below zero; calm (NODES,): of each curve, its own where
    not given.
    """
    values = plain(np.stack([curve.y for curve in curves]))
    calm = [curve.calm for curve in curves] if calm is None else calm
    still, moved = plain(np.stack(calm)), plain(np.stack(drawn(calm)))
    excess = {name: max(float(np.median(moved[name]) - still[name]), 0.0) for name in ranges & values.keys()}
    draws = plain(np.stack(drawn([curve.y for curve in curves])))
    # The place of an extreme was chosen by the noise that is there: about the noisy curve it would be chosen again.
    draws = {name: moved[name] if name.endswith(PLACE) else draw for name, draw in draws.items()}
    dulled = plain(np.stack([blurred(curve.y, curve.blur) for curve in curves]))
    # Rows whose places are uncertain have blurred the curve: what as much again takes off a range, they took off, too.
    lost = {name: max(float(values[name] - dulled[name]), 0.0) for name in excess}
    source = least_known(curve.noise.source for curve in curves)
    of_curves = figures_of(values, draws, samples, excess, RANGE_U, source)
    for name, off in lost.items():  # which is known no better than to itself
        figure = of_curves[name]
        of_curves[name] = replace(figure, value=figure.value + off, u=float(np.hypot(figure.u, off)))
    return of_curves


def blurred(y: Array, blur: float) -> Array:
    """A curve (NODES,) whose rows fell anywhere about their places, with a standard deviation of `blur` rad."""
    return np.asarray(np.fft.irfft(np.fft.rfft(y) * np.exp(-0.5 * (blur * ORDERS) ** 2), NODES))


def _where_laps_differ(laps: Array, rng: np.random.Generator) -> Array:
    """Errors (DRAWS, NODES) by what laps (L, NODES) differ by at some places and not at others.

    Noise of one spectrum is the same all around. A slow gauge that meets a jump of the curve at another moment in each
    lap is not, nor is a burst of wild readings: there any mixture of the laps may be true, by Student's law for so few
    of them.
    """
    count = len(laps)
    if count < 2:
        return np.zeros((DRAWS, NODES))
    apart = laps - laps.mean(axis=0)
    apart -= _smeared(apart, _SLOW)
    size = _smeared((apart**2).sum(axis=0), _LOCAL)
    odd = size > _ODD**2 * np.median(size)
    shares = rng.standard_t(count - 1, (DRAWS, count)).clip(-_MOST, _MOST) / np.sqrt(count * (count - 1))
    return np.asarray(shares @ (apart * odd))


def _smeared(values: Array, width: int) -> Array:
    """Means (..., NODES) of `width` nodes about each, an odd number, around the lap."""
    half = width // 2
    summed = np.cumsum(np.concatenate([values[..., -half - 1 :], values, values[..., :half]], axis=-1), axis=-1)
    return np.asarray((summed[..., width:] - summed[..., :-width]) / width)


def _misplaced(run: Reduced, rng: np.random.Generator) -> Array:
    """Errors (DRAWS, NODES, k) mm of rows that lie off their circle angle by their own times, where the curve jumps.

    The rows of a gauge that holds its value are off together, and in the next lap perhaps alike; in the middle of such
    a cell they are right, so that a steady slope averages out over it.
    """
    readings = max(run.readings, _FEWEST)
    cells = int(min(NODES, readings))
    wide = round(NODES / cells)
    mean = run.g_mm.mean(axis=0).T
    rough = mean - _smeared(mean, _SLOW if wide == 1 else 3 * wide | 1)
    half = max(1, wide // 2)
    slope = (np.roll(rough, -half, axis=1) - np.roll(rough, half, axis=1)) * (NODES / (4 * np.pi * half))
    off = run.blur * np.sqrt(min(1.0, NODES / (readings * len(run.g_mm))))
    errors: Array = rng.standard_normal((DRAWS, cells, len(slope)))
    errors *= off
    if cells < NODES:
        errors = errors[:, np.arange(NODES) * cells // NODES]
    errors *= slope.T
    return errors


def _stairs(run: Reduced, rng: np.random.Generator) -> Array:
    """Errors (DRAWS, NODES, k) mm that rounding may have made, wherever the steps lie.

    Laps share them: rows of one lap may lie where those of the next do.
    """
    mean = np.fft.irfft(np.fft.rfft(run.g_mm.mean(axis=0), axis=0) * _COARSE[:, None], NODES, axis=0)
    errors = np.zeros((DRAWS, NODES, mean.shape[1]))
    for k, (step, noise) in enumerate(zip(run.step_mm, run.noise_mm, strict=True)):
        if step:
            shared, single = rounding_error(mean[:, k], step, noise, rng.uniform(0, step, DRAWS))
            errors[..., k] = shared + np.sqrt(single * NODES / run.rows) * rng.standard_normal((DRAWS, NODES))
    return errors


def calmed(y: Array, power: Array) -> Array:
    """A curve (NODES,) with its noise, of this power (NODES // 2 + 1,), reduced.

    A running median keeps the jumps of plays, whose many orders would carry their noise along. Of what is left beside
    it each order is shrunk by the share that noise is likely to have in it (Wiener)."""
    half = _WINDOW // 2
    jumps = np.median(np.lib.stride_tricks.sliding_window_view(np.pad(y, half, mode="wrap"), _WINDOW), axis=1)
    spectrum = np.fft.rfft(y - jumps)
    seen = np.maximum(np.abs(spectrum / NODES) ** 2, 1e-30)
    return np.asarray(jumps + np.fft.irfft(spectrum * np.clip(1 - power / seen, 0.0, 1.0), NODES))
