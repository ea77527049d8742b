"""Closed curve over the circle angle: mean of the laps, with possible noise.

rows of a run  →  outliers and bursts removed  →  least-squares polyline of each lap  →  slips removed  →  mean

Every curve and every Monte Carlo draw (JCGM 101) consists of 720 numbers; only the reduction to these depends on the
number of rows. Figures refer to a stated angular resolution, as for the roundness of ISO 12181-2: a Gaussian filter
with 50 % transmission at 80 undulations per revolution (a wavelength of 4.5°). Without one, the range of a noisy curve
has no true value.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.procedures.shared.quantity import PLACE, Quantity, figures_of
from analysis.robot.geometry.circle import SENSE
from analysis.robot.kinematics.arm import Array, Integers, Mask
from analysis.runs.laps import Laps
from analysis.runs.noise.cell_noise import least_known
from analysis.runs.noise.readings import beyond_neighbours, is_outlier, noise_beneath, rounding_error, step_of
from analysis.runs.noise.spectrum import (
    DRAWS,
    NODES,
    ORDERS,
    LapNoise,
    bursts,
    changes,
    following,
    node_response,
    noise_of,
    power_of_ramp,
    without_drift,
    without_level_steps,
    without_slips,
)

PHI = 2 * np.pi * np.arange(NODES) / NODES
"""Circle angles (NODES,) rad of a curve."""
_STIFF = 1e-3
"""Weight of second differences relative to the number of rows per node. They bridge nodes that have no rows."""
_SOLVED = 1e-9
"""Relative tolerance: a picometre in a millimetre."""
_COARSEST = 10.0
"""Smallest travel of a gauge in quantisation steps. A smaller travel gives a curve of two or three values."""
_BASE_ROWS = 20_000
_BLOCK = 1 << 13
"""Number of rows processed at a time, to fit into the cache of the processor."""
_JUMPS = 2.0
"""Limit of an outlier in multiples of the line's change within two nodes."""


@dataclass(frozen=True)
class Reduced:
    """Laps of a run at NODES circle angles: g_mm (L, NODES, k) in order of time, at the angles order (NODES,).

    samples: rows of all laps. rows: per lap, without outliers. readings: per lap, changed readings of the gauge with
    most repetitions. rate: rad/s of phi. step_mm, noise_mm (k,): quantisation and the noise below it. blur: standard
    deviation, rad, of row positions from their times.
    """

    g_mm: Array
    order: Integers
    samples: int
    rows: float
    readings: float
    lap_s: float
    apart_s: float
    rate: float
    step_mm: tuple[float, ...]
    noise_mm: tuple[float, ...]
    blur: float
    notes: tuple[str, ...]


@dataclass(frozen=True)
class HatSums:
    """Sums over the rows between nodes per lap, (L, NODES).

    before, between, beyond: products of both hat functions. near, far (k, L, NODES): readings of each gauge times each
    hat function.
    """

    before: Array
    between: Array
    beyond: Array
    near: Array
    far: Array

    @property
    def rows(self) -> Array:
        """Number of rows in the lap: all products of hat functions add up to it."""
        return self.before + 2 * self.between + self.beyond

    def without(self, odd: Mask) -> HatSums:
        return HatSums(*(np.where(odd, 0.0, values) for values in vars(self).values()))

    def lines(self) -> Array:
        """Closed least-squares polylines (L, NODES, k), smoothed."""
        # Cyclic normal equations, slightly stiff to bridge nodes without rows, solved by conjugate gradients (Hestenes
        # and Stiefel 1952); about thirty rounds are sufficient if every node has rows.
        pull, diagonal = self.near + np.roll(self.far, 1, axis=2), self.before + np.roll(self.beyond, 1, axis=1)
        stiff = _STIFF * diagonal.mean(axis=1, keepdims=True)
        scale = 1 / (diagonal + 6 * stiff)

        def normal(x: Array) -> Array:
            bend = 2 * x - np.roll(x, 1, axis=-1) - np.roll(x, -1, axis=-1)
            bend = 2 * bend - np.roll(bend, 1, axis=-1) - np.roll(bend, -1, axis=-1)
            beside = self.between * np.roll(x, -1, axis=-1) + np.roll(self.between * x, 1, axis=-1)
            return np.asarray(diagonal * x + beside + stiff * bend)

        line: Array = scale * pull
        residual = pull - normal(line)
        way = scale * residual
        size = (residual * way).sum(axis=-1, keepdims=True)
        enough = _SOLVED**2 * np.maximum((pull * scale * pull).sum(axis=-1, keepdims=True), 1e-300)
        for _ in range(2 * NODES):
            if (size <= enough).all():
                break
            moved = normal(way)
            step = size / np.maximum((way * moved).sum(axis=-1, keepdims=True), 1e-300)
            line, residual = line + step * way, residual - step * moved
            before, size = size, (residual * scale * residual).sum(axis=-1, keepdims=True)
            way = scale * residual + size / np.maximum(before, 1e-300) * way
        smooth = np.fft.irfft(np.fft.rfft(line, axis=2) / node_response(), NODES, axis=2)
        return np.moveaxis(smooth, 0, 2)


def reduced(laps: Laps) -> Reduced:
    phi, g_mm = laps.phi, laps.g_mm
    lap = np.minimum(np.abs(phi - laps.start) // (2 * np.pi), laps.count - 1).astype(np.int64)
    # The level and the first two orders are removed before fitting polylines.
    some = slice(None, None, max(1, len(phi) // _BASE_ROWS))
    base = np.linalg.lstsq(_waves(phi[some]), g_mm[some], rcond=None)[0]
    rough = np.empty(g_mm.shape, order="F")
    for begin in range(0, len(phi), _BLOCK):
        rows = slice(begin, begin + _BLOCK)
        rough[rows] = g_mm[rows] - _waves(phi[rows]) @ base
    wild = outliers_of(phi, rough, lap)
    hats = _hat_sums(phi, rough, lap, ~np.any(wild, axis=0))
    added = _waves(PHI) @ base
    nodes = hats.lines() + added
    odd: Mask = np.any([bursts(of_gauge) for of_gauge in np.moveaxis(nodes, 2, 0)], axis=0)
    if odd.any():
        nodes = hats.without(odd).lines() + added
        nodes = np.stack([following(of_gauge, odd) for of_gauge in np.moveaxis(nodes, 2, 0)], axis=2)
    sense = int(SENSE[laps.direction])
    first = int(np.ceil(sense * laps.start / (2 * np.pi) * NODES - 1e-6)) * sense
    order: Integers = (first + sense * np.arange(NODES)) % NODES  # order of the circle angles in a lap
    nodes, slips = _steady(nodes[:, order])
    steps = tuple(step_of(column) for column in g_mm.T)
    rate = sense * 2 * np.pi / laps.lap_s
    return Reduced(
        nodes,
        order,
        len(phi),
        round(float(hats.rows.sum())) / laps.count,
        min(int(np.count_nonzero(column[1:] != column[:-1])) for column in g_mm.T) / laps.count,
        laps.lap_s,
        laps.apart_s,
        rate,
        steps,
        tuple(noise_beneath(column, step) for column, step in zip(g_mm.T, steps, strict=True)),
        abs(rate) * laps.u_t_s,
        (*_remarks(g_mm, steps, wild, round(float(hats.rows[odd].sum()))), *slips),
    )


def _remarks(g_mm: Array, steps: Sequence[float], wild: Mask, burst: int) -> list[str]:
    notes = []
    if wild.any():
        counts = ", ".join(map(str, np.count_nonzero(wild, axis=1)))
        notes.append(f"outliers are ignored: {counts} of {wild.shape[1]} (g1, g2)")
    for k, (moves, step) in enumerate(zip(np.ptp(g_mm, axis=0), steps, strict=True), start=1):
        if moves < _COARSEST * step:
            fact = f"g{k} reads in steps of {1e3 * step:.3g} µm and moves by {1e3 * moves:.3g} µm only, which is too"
            notes.append(f"{fact} coarse to show the curve: use a finer gauge or set the resolution")
    if burst:
        notes.append(f"{burst} readings near bursts of outliers are ignored: the other laps replace them")
    return notes


def outliers_of(phi: Array, rough: Array, lap: Integers) -> Mask:
    """Mask (k, n) of the outliers among readings rough (n, k) of laps (n,), numbered from 0."""
    wild = np.array([is_outlier(column) for column in rough.T])
    if not wild.any():
        return wild
    # After a first outlier, further ones may be too dense for comparison with neighbours: they deviate from the
    # polyline through all readings by more than its local change, such as at a crossing of backlash.
    lines = _hat_sums(phi, rough, lap, ~np.any(wild, axis=0)).lines()
    node, share = place_of(phi)
    for k, of_gauge in enumerate(np.moveaxis(lines, 2, 0)):
        line = of_gauge[lap, node] * (1 - share) + of_gauge[lap, (node + 1) % NODES] * share
        away = np.abs(rough[:, k] - line)
        change = np.stack([changes(of_lap) for of_lap in of_gauge])
        wild[k] |= beyond_neighbours(away) & (away > _JUMPS * change[lap, node])
    return wild


def nodes_of(phi: Array, y: Array) -> Array:
    """A noise-free curve y (n,) over phi (n,) rad, of one lap, at PHI."""
    once, all_rows = np.zeros(len(phi), dtype=np.int64), np.ones(len(phi), dtype=bool)
    base = np.asarray(np.linalg.lstsq(_waves(phi), y[:, None], rcond=None)[0], dtype=np.float64)
    rough = y[:, None] - _waves(phi) @ base
    return np.asarray((_hat_sums(phi, rough, once, all_rows).lines()[0] + _waves(PHI) @ base)[:, 0])


def _waves(phi: Array) -> Array:
    return np.stack([np.ones_like(phi), np.sin(phi), np.cos(phi), np.sin(2 * phi), np.cos(2 * phi)], axis=1)


def _hat_sums(phi: Array, values: Array, lap: Integers, keep: Mask) -> HatSums:
    shape = (int(lap.max()) + 1, NODES)
    if not keep.all():
        phi, values, lap = phi[keep], values[keep], lap[keep]
    cell, share = place_of(phi)
    at = lap * NODES + cell

    def summed(weights: Array) -> Array:
        return np.asarray(np.bincount(at, weights, shape[0] * NODES).reshape(shape), dtype=np.float64)

    near, far = (np.stack([summed(weight * column) for column in values.T]) for weight in (1 - share, share))
    return HatSums(summed((1 - share) ** 2), summed(share * (1 - share)), summed(share**2), near, far)


def place_of(phi: Array) -> tuple[Integers, Array]:
    """Node behind each circle angle, and the relative position to the next."""
    place = phi % (2 * np.pi) * (NODES / (2 * np.pi))
    node = np.floor(place)
    return node.astype(np.int64) % NODES, place - node


def _steady(nodes: Array) -> tuple[Array, tuple[str, ...]]:
    steady, notes = [], []
    for name, laps in zip(("g1", "g2"), np.moveaxis(nodes, 2, 0), strict=False):
        whole, slips = without_slips(laps)
        steady.append(whole)
        if slips:
            sizes = ", ".join(f"{1e3 * slip:+z.1f}" for slip in slips)
            notes.append(f"{name} slipped between the laps by {sizes} µm, which was removed: check the clamp")
    return np.stack(steady, axis=2), tuple(notes)


SEED = 0
"""Seed of the noise draws, fixed so that a run always gives the same report."""
UNDULATIONS = 80.0
"""Undulations per revolution with 50 % transmission: ISO 12181-2 has 15, 50, 150 and 500 for roundness; robot gears
have orders up to about 60, and reversals take a degree and more."""
_PASSES = 0.5 ** ((ORDERS / UNDULATIONS) ** 2)
_COARSE = 0.5 ** ((ORDERS / 40.0) ** 2)
"""Filter that smooths quantisation steps, so that other positions of the steps can be simulated."""
_WINDOW = 21
"""Width of the running median in nodes: 10°, less than the distance of most reversals."""
_LOCAL, _SLOW = 19, 81
"""Widths for comparing laps in nodes: twice the stated resolution, relative to differences within 40°."""
_ODD, _MOST = 2.0, 5.0
"""Multiple of the usual difference between laps above which the cause is not noise, and the limit of random draws.

The draws from Student's distribution with one degree of freedom would otherwise be unlimited.
"""
_FEWEST = 8.0
"""Smallest number of readings per lap assumed for jumps. A gauge that moves by hardly a step has fewer."""
RANGE_U = 0.5
"""Relative uncertainty of the noise correction of a range, because the noise-free curve is only an estimate."""

Plain = Callable[[Array], Mapping[str, Array]]
"""Figures (...,) by name of curves (..., NODES)."""


@dataclass(frozen=True)
class LapCurve:
    """Curve y (NODES,) over PHI, and possible noise errors (DRAWS, NODES).

    power (NODES // 2 + 1,): likely mean square of the noise per order. blur: standard deviation of the position of a
    row, in rad. slips: removed level steps between laps. again: recreates the curve with equal draws.
    """

    y: Array
    again: Callable[[], LapCurve]
    power: Array
    laps: Array
    noise: LapNoise
    rate: float
    blur: float
    slips: tuple[float, ...]

    @cached_property
    def errors(self) -> Array:
        """Errors (DRAWS, NODES): 2.3 MB, neither sent between processes nor stored with a result."""
        return self.again().errors

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "errors"}

    @property
    def calm(self) -> Array:
        return calmed(self.y, self.power)

    def turned(self, lag_s: Array) -> NDArray[np.complex128]:
        """Factors of each order, (DRAWS, NODES // 2 + 1), for lags (DRAWS,) s of the gauges."""
        factors: NDArray[np.complex128] = np.exp(-1j * ORDERS * self.rate * lag_s[:, None])
        return factors

    def draw_noise(self, curve: Array, turned: NDArray[np.complex128], scale: Array) -> Array:
        """This curve (NODES,), or its smoothed version, with new noise, lag and relative scale: (DRAWS, NODES)."""
        return np.fft.irfft(np.fft.rfft(curve) * turned, NODES, axis=1) / scale[:, None] + self.errors


def curve_of(
    run: Reduced, values: Callable[[Array], Array], per_mm: float, channel: int = 0, like: LapNoise | None = None
) -> LapCurve:
    """Curve of `values`, a function of readings (..., k) mm, with sensitivity per_mm to gauge noise.

    like: noise of a different run of the cell, for a single lap.
    """
    # Draws of two directions, and of angle and distance, are independent.
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
    # It is unknown which of two levels is correct.
    power[:, 0] += float(np.square(slips).sum()) / 4
    # The level is that of the middle of the run; at its start, with zeroed gauges, it was half the drift away.
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
    """Figures of several curves by name, with uncertainties from simulated noise.

    plain: figures of stacked curves (curves, ..., NODES). drawn: simulated curves (DRAWS, NODES) around each curve.
    ranges: figures that noise increases; each is lowered by its median contribution to that of a smoothed curve, to
    zero at least. calm: smoothed curve for each curve, by default its own.
    """
    values = plain(np.stack([curve.y for curve in curves]))
    calm = [curve.calm for curve in curves] if calm is None else calm
    still, moved = plain(np.stack(calm)), plain(np.stack(drawn(calm)))
    excess = {name: max(float(np.median(moved[name]) - still[name]), 0.0) for name in ranges & values.keys()}
    draws = plain(np.stack(drawn([curve.y for curve in curves])))
    # The position of an extreme depends on the present noise; around the noisy curve it would be selected twice.
    draws = {name: moved[name] if name.endswith(PLACE) else draw for name, draw in draws.items()}
    dulled = plain(np.stack([blurred(curve.y, curve.blur) for curve in curves]))
    # Position errors have blurred the curve: blurring it again estimates the loss of a range.
    lost = {name: max(float(values[name] - dulled[name]), 0.0) for name in excess}
    source = least_known(curve.noise.source for curve in curves)
    of_curves = figures_of(values, draws, samples, excess, RANGE_U, source)
    for name, off in lost.items():  # this correction has 100 % uncertainty
        figure = of_curves[name]
        of_curves[name] = replace(figure, value=figure.value + off, u=float(np.hypot(figure.u, off)))
    return of_curves


def blurred(y: Array, blur: float) -> Array:
    return np.asarray(np.fft.irfft(np.fft.rfft(y) * np.exp(-0.5 * (blur * ORDERS) ** 2), NODES))


def _where_laps_differ(laps: Array, rng: np.random.Generator) -> Array:
    """Simulated errors (DRAWS, NODES) for places at which the laps (L, NODES) differ.

    Stationary noise is equal at all angles. A slow gauge that samples a jump at different times is not, and neither is
    a burst of outliers. At such places any mixture of the laps is possible, by Student's distribution for few laps.
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
    half = width // 2
    summed = np.cumsum(np.concatenate([values[..., -half - 1 :], values, values[..., :half]], axis=-1), axis=-1)
    return np.asarray((summed[..., width:] - summed[..., :-width]) / width)


def _misplaced(run: Reduced, rng: np.random.Generator) -> Array:
    """Simulated errors (DRAWS, NODES, k) mm of rows with a wrong circle angle, because of a wrong time, at jumps of the
    curve.

    The rows of a repeated reading are wrong together, possibly equally in the next lap. On a steady slope these errors
    average out.
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
    """Simulated quantisation errors (DRAWS, NODES, k) mm, for any position of the steps, equal in all laps."""
    mean = np.fft.irfft(np.fft.rfft(run.g_mm.mean(axis=0), axis=0) * _COARSE[:, None], NODES, axis=0)
    errors = np.zeros((DRAWS, NODES, mean.shape[1]))
    for k, (step, noise) in enumerate(zip(run.step_mm, run.noise_mm, strict=True)):
        if step:
            shared, single = rounding_error(mean[:, k], step, noise, rng.uniform(0, step, DRAWS))
            errors[..., k] = shared + np.sqrt(single * NODES / run.rows) * rng.standard_normal((DRAWS, NODES))
    return errors


def calmed(y: Array, power: Array) -> Array:
    """Curve (NODES,) with reduced noise.

    A running median preserves the jumps of backlash, whose many orders would preserve noise. Each order of the
    remainder is reduced by its likely share of noise (Wiener filter).
    """
    half = _WINDOW // 2
    jumps = np.median(np.lib.stride_tricks.sliding_window_view(np.pad(y, half, mode="wrap"), _WINDOW), axis=1)
    spectrum = np.fft.rfft(y - jumps)
    seen = np.maximum(np.abs(spectrum / NODES) ** 2, 1e-30)
    return np.asarray(jumps + np.fft.irfft(spectrum * np.clip(1 - power / seen, 0.0, 1.0), NODES))
