"""A closed curve over circle angle: the mean of the laps that were driven, with what noise may have added to it.

    rows of a run  →  readings at 720 circle angles, lap by lap  →  slips, bursts and drift taken out  →  their mean

Cost grows with the rows once, for the least-squares broken line through them; every figure and every Monte Carlo draw
(JCGM 101) is then of 720 numbers. Figures are those of the curve at a stated angular resolution, as in the roundness of
ISO 12181-2: a Gaussian filter that passes half of 80 undulations per revolution (a wavelength of 4.5°). The range of a
noisy curve without one has no true value.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.kinematics.arm import Array
from analysis.model.circle import SENSE
from analysis.noise.laps import (
    bursts,
    following,
    power_of_ramp,
    without_drift,
    without_level_steps,
    without_slips,
)
from analysis.noise.readings import Mask, is_wild, noise_beneath, rounding_error, step_of
from analysis.noise.spectrum import DRAWS, NODES, ORDERS, Integers, LapNoise, node_response, noise_of
from analysis.reading.laps import Laps
from analysis.reporting.quantity import Quantity, figures_of

SEED = 0
"""Fixed, so that the same run gives the same report."""
PHI = 2 * np.pi * np.arange(NODES) / NODES
"""The circle angles (NODES,) rad of a curve."""
UNDULATIONS = 80.0
"""Per revolution, of which half pass: ISO 12181-2 has 15, 50, 150 and 500 for roundness; robots' gears have orders up
to some 60, and their reversals transits of a degree and more."""
_PASSES = 0.5 ** ((ORDERS / UNDULATIONS) ** 2)
_COARSE = 0.5 ** ((ORDERS / 20.0) ** 2)
"""Smooths away the stairs that rounding makes, so that other stairs can be tried."""
_STIFF = 1e-3
"""Of the rows at a node: weight of second differences, which bridge nodes without rows."""
_SOLVED = 1e-9
"""Relative: a picometre in a millimetre."""
_COARSEST = 10.0
"""Steps that a gauge must move by: with fewer the curve lies between two or three values."""
_BASE_ROWS = 20_000
_BLOCK = 1 << 17
"""Rows at a time, so that a long run needs no memory for all of them."""
_WINDOW = 21
"""Nodes of the running median: 10°, less than lies between most reversals."""
_LOCAL = 19
"""Nodes within which laps are compared: twice the stated resolution."""
_ODD, _MOST = 3.0, 5.0
"""Laps that differ by so many times the usual differ for another reason than noise; and how far Student's law with one
degree of freedom is followed."""
_RANGE_U = 0.5
"""Share of the correction for noise by which a range is uncertain: the curve without noise is itself an estimate."""

Plain = Callable[[Array], Mapping[str, Array]]
"""The plain figures (...,) by name of curves (..., NODES)."""


@dataclass(frozen=True)
class Reduced:
    """A run's laps at NODES circle angles. g_mm (L, NODES, k) in order of time; order (NODES,): which circle angle each
    is; rows: in a lap; rate: rad/s of phi; step_mm, noise_mm (k,): rounding of each gauge and the noise beneath it;
    blur: standard deviation, rad, of where rows fell by their own times."""

    g_mm: Array
    order: Integers
    rows: float
    lap_s: float
    apart_s: float
    rate: float
    step_mm: tuple[float, ...]
    noise_mm: tuple[float, ...]
    blur: float
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Curve:
    """A curve y (NODES,) over PHI, and errors (DRAWS, NODES) that noise may have put into it; power (NODES // 2 + 1,):
    likely mean square of these in each order; laps (L, NODES) that y is the mean of; drift: of a lap; rate: rad/s of
    phi; blur: of a row's place, rad; slips: steps of the level between laps, taken out."""

    y: Array
    errors: Array
    power: Array
    laps: Array
    noise: LapNoise
    drift: float
    rate: float
    blur: float
    slips: tuple[float, ...]

    @property
    def calm(self) -> Array:
        """y (NODES,) with its noise reduced."""
        return calmed(self.y, self.power)

    def drawn(self, curve: Array, lag_s: Array, scale: Array) -> Array:
        """A curve (NODES,), this one or its calm, as runs with other noise, lag_s (DRAWS,) and relative scale (DRAWS,)
        might have shown it: (DRAWS, NODES)."""
        turned = np.exp(-1j * ORDERS * self.rate * lag_s[:, None])
        return np.fft.irfft(np.fft.rfft(curve) * turned, NODES, axis=1) / scale[:, None] + self.errors


def reduced(laps: Laps) -> Reduced:
    """The readings of a run at NODES circle angles, lap by lap; wild readings are left out and counted."""
    some = slice(None, None, max(1, len(laps.phi) // _BASE_ROWS))
    base = np.asarray(np.linalg.lstsq(_waves(laps.phi[some]), laps.g_mm[some], rcond=None)[0], dtype=np.float64)
    rough = _less_base(laps.phi, laps.g_mm, base)
    wild = np.array([is_wild(column) for column in rough.T])
    keep: Mask = ~np.any(wild, axis=0)
    lap = np.minimum(np.abs(laps.phi - laps.start) // (2 * np.pi), laps.count - 1).astype(np.int64)
    nodes = _broken_lines(laps.phi, rough, lap, keep) + _waves(PHI) @ base
    odd: Mask = np.any([bursts(of_gauge) for of_gauge in np.moveaxis(nodes, 2, 0)], axis=0)
    if odd.any():
        left = np.floor(laps.phi % (2 * np.pi) * (NODES / (2 * np.pi))).astype(np.int64) % NODES
        burst = keep & odd[lap, left]
        nodes = _broken_lines(laps.phi, rough, lap, keep & ~burst) + _waves(PHI) @ base
        nodes = np.stack([following(of_gauge, odd) for of_gauge in np.moveaxis(nodes, 2, 0)], axis=2)
    order = _driven(laps)
    nodes, notes = _steady(nodes[:, order])
    if odd.any():
        notes = (
            f"{int(burst.sum())} readings beside bursts of wild ones left out: there a lap follows the others",
            *notes,
        )
    steps = tuple(step_of(g_mm) for g_mm in laps.g_mm.T)
    beneath = tuple(noise_beneath(g_mm, step) for g_mm, step in zip(laps.g_mm.T, steps, strict=True))
    notes = (*_coarse(laps.g_mm, steps), *notes)
    if wild.any():
        notes = (f"wild readings left out: {', '.join(map(str, wild.sum(axis=1)))} of {len(keep)} (g1, g2)", *notes)
    rate = SENSE[laps.direction] * 2 * np.pi / laps.lap_s
    rows = float(keep.sum()) / laps.count
    return Reduced(nodes, order, rows, laps.lap_s, laps.apart_s, rate, steps, beneath, abs(rate) * laps.u_t_s, notes)


def _coarse(g_mm: Array, steps: Sequence[float]) -> tuple[str, ...]:
    """Which gauges (n, k) mm read in steps too coarse for how far they move, in words."""
    return tuple(
        f"g{k} reads in steps of {1e3 * step:.3g} µm and moves by {1e3 * np.ptp(column):.3g} µm only, too coarse to "
        "show the curve: use a finer gauge or set its resolution"
        for k, (column, step) in enumerate(zip(g_mm.T, steps, strict=True), start=1)
        if np.ptp(column) < _COARSEST * step
    )


def nodes_of(phi: Array, y: Array) -> Array:
    """A noise-free curve y (n,) over phi (n,) rad, of one lap, at PHI (NODES,)."""
    once, all_rows = np.zeros(len(phi), dtype=np.int64), np.ones(len(phi), dtype=bool)
    base = np.asarray(np.linalg.lstsq(_waves(phi), y[:, None], rcond=None)[0], dtype=np.float64)
    rough = y[:, None] - _waves(phi) @ base
    nodes: Array = (_broken_lines(phi, rough, once, all_rows)[0] + _waves(PHI) @ base)[:, 0]
    return nodes


def curve_of(
    run: Reduced, values: Callable[[Array], Array], per_mm: float, channel: int = 0, like: LapNoise | None = None
) -> Curve:
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
    # Nobody knows which of two levels is the right one.
    power[:, 0] += float(np.square(slips).sum()) / 4
    # The level is that of any moment along the drift.
    power[:, 0] += (drift**2 + variance) * (len(laps) * run.apart_s / run.lap_s) ** 2 / 12
    parts = rng.standard_normal((2, *power.shape)) * np.sqrt(power / 2)
    spectra = parts[0] + 1j * parts[1]
    spectra[:, 0] = np.sqrt(2) * parts[0][:, 0]
    mean = run.g_mm.mean(axis=0)
    errors: Array = np.fft.irfft(spectra, NODES, axis=1) * NODES + values(mean + _stairs(run, rng)) - values(mean)
    errors += _where_laps_differ(laps, rng)
    place = np.argsort(run.order)
    likely = np.exp(np.log(power).mean(axis=0))
    return Curve(
        laps.mean(axis=0)[place],
        errors[:, place],
        likely,
        laps[:, place],
        noise,
        drift,
        run.rate,
        run.blur,
        tuple(slips),
    )


def at_resolution(y: Array) -> Array:
    """Curves (..., NODES) at the stated angular resolution."""
    filtered: Array = np.fft.irfft(np.fft.rfft(y) * _PASSES, NODES)
    return filtered


def figures(
    plain: Plain,
    curves: Sequence[Curve],
    drawn: Callable[[Sequence[Array]], Sequence[Array]],
    samples: int,
    ranges: frozenset[str],
    calm: Sequence[Array] | None = None,
) -> dict[str, Quantity]:
    """Figures by name of some curves together: `plain` takes them stacked, (curves, ..., NODES).

    drawn: the draws (DRAWS, NODES) of each about the curves that it is given. A range is lowered by as much as noise
    makes the calm curve's larger, never below zero; calm (NODES,): of each curve, its own where not given.
    """
    values = plain(np.stack([curve.y for curve in curves]))
    calm = [curve.calm for curve in curves] if calm is None else calm
    still, moved = plain(np.stack(calm)), plain(np.stack(drawn(calm)))
    excess = {name: max(float(np.mean(moved[name]) - still[name]), 0.0) for name in ranges & values.keys()}
    draws = plain(np.stack(drawn([curve.y for curve in curves])))
    # The place of an extreme was chosen by the noise that is there: about the noisy curve it would be chosen again.
    draws = {name: moved[name] if name.endswith("_at_deg") else draw for name, draw in draws.items()}
    blurred = plain(np.stack([_blurred(curve.y, curve.blur) for curve in curves]))
    # Rows whose places are uncertain have blurred the curve: what as much again takes off a range, they took off, too.
    lost = {name: max(float(values[name] - blurred[name]), 0.0) for name in excess}
    source = max((curve.noise.source for curve in curves), key=("measured", "borrowed", "assumed").index)
    found = figures_of(values, draws, samples, excess, _RANGE_U, source)
    return found | {name: _sharpened(found[name], lost[name]) for name in lost}


def _sharpened(figure: Quantity, lost: float) -> Quantity:
    """A range with what a blur took off it, which is known no better than to itself."""
    return replace(figure, value=figure.value + lost, u=float(np.hypot(figure.u, lost)))


def _blurred(y: Array, blur: float) -> Array:
    """A curve (NODES,) whose rows fell anywhere about their places, with a standard deviation of `blur` rad."""
    found: Array = np.fft.irfft(np.fft.rfft(y) * np.exp(-0.5 * (blur * ORDERS) ** 2), NODES)
    return found


def _waves(phi: Array) -> Array:
    """Level and the first two orders (n, 5) at phi (n,)."""
    return np.stack([np.ones_like(phi), np.sin(phi), np.cos(phi), np.sin(2 * phi), np.cos(2 * phi)], axis=1)


def _less_base(phi: Array, values: Array, base: Array) -> Array:
    """Values (n, k) without level and first two orders (5, k), which the broken line need not follow, in blocks."""
    left = np.empty(values.shape)
    for begin in range(0, len(values), _BLOCK):
        rows = slice(begin, begin + _BLOCK)
        left[rows] = values[rows] - _waves(phi[rows]) @ base
    return left


def _broken_lines(phi: Array, values: Array, lap: Integers, keep: Mask) -> Array:
    """The closed broken lines (L, NODES, k) through NODES that fit values (n, k) best, lap by lap, as smooth curves.

    The normal equations of hat functions are summed over blocks of rows.
    """
    count = int(lap.max()) + 1
    beyond, between, before = (np.zeros(count * NODES) for _ in range(3))
    pull_left, pull_right = (np.zeros((values.shape[1], count * NODES)) for _ in range(2))
    for begin in range(0, len(phi), _BLOCK):
        rows = begin + np.flatnonzero(keep[begin : begin + _BLOCK])
        place = phi[rows] % (2 * np.pi) * (NODES / (2 * np.pi))
        left = np.floor(place)
        share = place - left
        at = lap[rows] * NODES + left.astype(np.int64) % NODES
        before += np.bincount(at, (1 - share) ** 2, len(before))
        between += np.bincount(at, share * (1 - share), len(before))
        beyond += np.bincount(at, share**2, len(before))
        for k, column in enumerate(values[rows].T):
            pull_left[k] += np.bincount(at, (1 - share) * column, len(before))
            pull_right[k] += np.bincount(at, share * column, len(before))
    shape = (values.shape[1], count, NODES)
    pull = pull_left.reshape(shape) + np.roll(pull_right.reshape(shape), 1, axis=2)
    diagonals = before.reshape(count, NODES) + np.roll(beyond.reshape(count, NODES), 1, axis=1)
    lines = _solved(diagonals, between.reshape(count, NODES), pull)
    smooth = np.fft.irfft(np.fft.rfft(lines, axis=2) / node_response(), NODES, axis=2)
    nodes: Array = np.moveaxis(smooth, 0, 2)
    return nodes


def _solved(diagonal: Array, beside: Array, pull: Array) -> Array:
    """The broken lines (k, L, NODES) of cyclic normal equations, a little stiff, so that a node without rows is
    bridged.

    By conjugate gradients (Hestenes and Stiefel 1952): some thirty steps where every node has rows.
    """
    stiff = _STIFF * diagonal.mean(axis=1, keepdims=True)
    scale = 1 / (diagonal + 6 * stiff)

    def normal(x: Array) -> Array:
        bend = 2 * x - np.roll(x, 1, axis=-1) - np.roll(x, -1, axis=-1)
        bend = 2 * bend - np.roll(bend, 1, axis=-1) - np.roll(bend, -1, axis=-1)
        moved: Array = diagonal * x + beside * np.roll(x, -1, axis=-1) + np.roll(beside * x, 1, axis=-1) + stiff * bend
        return moved

    line: Array = scale * pull
    left = pull - normal(line)
    way = scale * left
    size = (left * way).sum(axis=-1, keepdims=True)
    enough = _SOLVED**2 * np.maximum((pull * scale * pull).sum(axis=-1, keepdims=True), 1e-300)
    for _ in range(2 * NODES):
        if (size <= enough).all():
            break
        moved = normal(way)
        step = size / np.maximum((way * moved).sum(axis=-1, keepdims=True), 1e-300)
        line, left = line + step * way, left - step * moved
        before, size = size, (left * scale * left).sum(axis=-1, keepdims=True)
        way = scale * left + size / np.maximum(before, 1e-300) * way
    return line


def _driven(laps: Laps) -> Integers:
    """Circle angles (NODES,) by number, in the order in which a lap comes to them."""
    sense = int(SENSE[laps.direction])
    first = int(np.ceil(sense * laps.start / (2 * np.pi) * NODES - 1e-6)) * sense
    order: Integers = (first + sense * np.arange(NODES)) % NODES
    return order


def _steady(nodes: Array) -> tuple[Array, tuple[str, ...]]:
    """Laps (L, NODES, k) mm of the gauges without slips, and what was found, in words."""
    mended, notes = [], []
    for name, laps in zip(("g1", "g2"), np.moveaxis(nodes, 2, 0), strict=False):
        whole, slips = without_slips(laps)
        mended.append(whole)
        if slips:
            sizes = ", ".join(f"{1e3 * slip:+.1f}" for slip in slips)
            notes.append(f"{name} slipped between its laps by {sizes} µm, which was taken out: check its clamp")
    return np.stack(mended, axis=2), tuple(notes)


def _where_laps_differ(laps: Array, rng: np.random.Generator) -> Array:
    """Errors (DRAWS, NODES) by what laps (L, NODES) differ by at some places and not at others.

    Noise of one spectrum is the same all around. A slow gauge that meets a jump of the curve at another moment in each
    lap is not: there any mixture of the laps may be true, by Student's law for so few of them.
    """
    count = len(laps)
    if count < 2:
        return np.zeros((DRAWS, NODES))
    apart = laps - laps.mean(axis=0)
    width = np.ones(_LOCAL) / _LOCAL
    size = np.fft.irfft(np.fft.rfft((apart**2).sum(axis=0)) * np.fft.rfft(width, NODES), NODES)
    size = np.roll(np.maximum(size, 0.0), -(_LOCAL // 2))
    odd = size > _ODD**2 * np.median(size)
    shares = rng.standard_t(count - 1, (DRAWS, count)).clip(-_MOST, _MOST) / np.sqrt(count * (count - 1))
    errors: Array = shares @ (apart * odd)
    return errors


def _stairs(run: Reduced, rng: np.random.Generator) -> Array:
    """Errors (DRAWS, NODES, k) mm that rounding may have made, wherever the steps lie."""
    mean = np.fft.irfft(np.fft.rfft(run.g_mm.mean(axis=0), axis=0) * _COARSE[:, None], NODES, axis=0)
    columns = [
        rounding_error(g_mm, step, noise, rng.uniform(0, step, DRAWS)) if step else np.zeros((DRAWS, NODES))
        for g_mm, step, noise in zip(mean.T, run.step_mm, run.noise_mm, strict=True)
    ]
    return np.stack(columns, axis=2)


def calmed(y: Array, power: Array) -> Array:
    """A curve (NODES,) with its noise, of this power (NODES // 2 + 1,), reduced.

    A running median keeps the jumps of plays, whose many orders would carry their noise along. Of what is left beside
    it each order is shrunk by the share that noise is likely to have in it (Wiener)."""
    half = _WINDOW // 2
    jumps = np.median(np.lib.stride_tricks.sliding_window_view(np.pad(y, half, mode="wrap"), _WINDOW), axis=1)
    spectrum = np.fft.rfft(y - jumps)
    seen = np.maximum(np.abs(spectrum / NODES) ** 2, 1e-30)
    calm: Array = jumps + np.fft.irfft(spectrum * np.clip(1 - power / seen, 0.0, 1.0), NODES)
    return calm
