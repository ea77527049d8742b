"""The scatter at targets: the noise of readings of the same targets, with a separate size for each target and heavy
tails.

The model. Reading r of cell c (an orientation, a side of approach, a coordinate) of target t is

    g = m_tc + drift(time) + e,   e ~ sigma_t × Student t with nu degrees of freedom,
    sigma_t² ~ d0 s0² / χ²(d0).

The last line moderates the variances (Smyth, Stat. Appl. Genet. Mol. Biol. 3, 2004): a target read twice borrows from
the others to the degree of their agreement (d0). nu accounts for heavy tails and outliers. All unknowns are drawn
together by Gibbs sampling, in many short parallel chains, so the uncertainty of the noise is part of every uncertainty.
If the gauge reads in steps, all readings of a cell share a part of their rounding error, which is larger for smaller
scatter.

Each test defines the relation between the cells of a target by a `Level`, which draws the cells. For a hemisphere it is
sphere + tilt + error of the target + error of the orientation. A tilt of the tool shifts all targets equally, like a
wrong TCP. The errors of targets and of single orientations belong to the robot, and their widths are estimated too. The
value of a cell is then drawn from the readings and from the neighbours in the model, which prevents too large ranges
over noisy cells.

If no target is read twice, s0 is restricted to the range of real cells (`cell.TARGET_MM`): the scatter is assumed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from analysis.robot.kinematics.arm import Array
from analysis.runs.noise.cell_noise import DRIFT_MM_PER_S, TARGET_MM, NoiseSource
from analysis.runs.noise.readings import rms, shared_rounding

_SEED = 0
"""Seed of the sampler, fixed so that a run always gives the same report."""
_CHAINS, _FEWEST_CHAINS = 64, 16
"""Number of parallel chains, and the smallest number for long tables. With the states stored they give 256 and 64
draws, which determine a standard deviation to 4 and 9 %."""
_ELEMENTS = 2_000_000
"""Readings times chains: tables of several thousand readings use fewer chains, and need fewer. Chosen: it limits the
memory to some 16 MB per array."""
_SWEEPS, _KEPT, _EVERY = 16, 4, 2
"""Number of sweeps of every chain, number of last states used, and sweeps between these states. The median scatter
of 24 simulated tables is 18 % larger with 8, 10 % with 16 and 4 % with 32 sweeps than with 64."""
_TAILS = np.array([2.2, 3.0, 5.0, 10.0, 50.0])
"""Candidate degrees of freedom of Student's t, with equal prior probability; 50 is close to a normal distribution."""
_AGREEMENT = np.array([1.0, 1.5, 2.5, 4.0, 8.0, 16.0, 64.0])
"""Candidate values of d0. 1.5 is a log-uniform spread of factor 20, as in `TARGET_MM`; 64 is nearly the same scatter
at all targets."""
_MEASURED_FREEDOM = 3
"""Degrees of freedom from which a scatter counts as measured: three determine a standard deviation to 41 %."""
_LEAST_MM = 1e-6
"""Smallest uncertainty of a reading, 1 nm, which avoids a division by zero."""
_FIRST_D0 = 2.0
"""Value of d0 for the initial variances of the chains. It has no effect after the chains have mixed."""
_DRIFT_DEGREE = 3
"""Degree of the polynomial of the drift. Chosen: a cubic follows warming and a reversal."""

Level = Callable[[np.random.Generator, Array, Array], tuple[Array, Array]]
"""A function that returns, from weights and weighted means (m, t, k) of the cells, their expected values and a draw,
both (m, t, k)."""


@dataclass(frozen=True)
class Scatter:
    """m draws of the scatter.

    sd_mm (m, t): standard deviation of a reading. tail (m,): degrees of freedom. best_mm (t, k), cell_mm (m, t, k):
    expected values and draws of the cells at the middle of the run. drift_mm (t, k, n): expected drift of each reading
    since then. drifted_mm: root mean square of the drift between the start and then. step_mm: step of the gauge; sd_mm
    includes the rounding.
    """

    sd_mm: Array
    tail: Array
    best_mm: Array
    cell_mm: Array
    drift_mm: Array
    drifted_mm: float
    noise: NoiseSource
    step_mm: float = 0.0

    def beneath(self, rng: np.random.Generator) -> Scatter:
        """Scatter before rounding; uniform between zero and the apparent size if steps hide it."""
        if self.step_mm == 0:
            return self
        noise_sq = np.maximum(self.sd_mm**2 - self.step_mm**2 / 12, 0.0)
        hidden = shared_rounding(self.step_mm, noise_sq) / (self.step_mm**2 / 12)
        return replace(self, sd_mm=np.sqrt(noise_sq) * (1 - hidden * rng.uniform(size=(len(noise_sq), 1))), step_mm=0.0)

    def again(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
        wide = (len(self.tail), 1) + (1,) * len(shape)
        size = self.sd_mm.shape + shape
        chi2 = 2.0 * rng.standard_gamma(np.broadcast_to(self.tail.reshape(wide) / 2, size))
        t = rng.standard_normal(size) / np.sqrt(chi2 / self.tail.reshape(wide))
        sd = self.sd_mm.reshape(self.sd_mm.shape + (1,) * len(shape))
        values: Array = sd * t
        return values


def separate(rng: np.random.Generator, weight: Array, mean: Array) -> tuple[Array, Array]:
    """Expected values and draws (m, t, k) of independent cells: a `Level`."""
    return mean, mean + rng.standard_normal(mean.shape) / np.sqrt(np.maximum(weight, 1e-12))


def freedom_of(readings_mm: Array) -> int:
    return int((np.isfinite(readings_mm).sum(axis=-1) - 1).clip(min=0).sum())


def scatter_of(
    readings_mm: Array, u_mm: float, t_s: Array | None = None, level: Level = separate, step_mm: float = 0.0
) -> Scatter:
    """Estimate the scatter at each of t targets from readings (t, k, n) mm in k cells, NaN if missing.

    u_mm: standard uncertainty of a gauge reading in addition to the rounding to step_mm (variance step²/12), a lower
    limit of the scatter. t_s: times of the readings, if drift is to be separated from scatter.
    """
    measured = freedom_of(readings_mm) >= _MEASURED_FREEDOM
    sampler = _Sampler(readings_mm, max(math.hypot(u_mm, step_mm / math.sqrt(12)), _LEAST_MM), measured, t_s, step_mm)
    sampler.begin()
    kept = []
    for sweep in range(_SWEEPS):
        best, cell = sampler.sweep(level)
        if (_SWEEPS - 1 - sweep) % _EVERY == 0 and _SWEEPS - 1 - sweep < _KEPT * _EVERY:
            kept.append((np.sqrt(sampler.variance), sampler.tail, best, cell, sampler.drift))
    sd, tail, best, cell, drift = (np.concatenate(part) for part in zip(*kept, strict=True))
    at_start, expected = drift @ sampler.shapes[sampler.first], sampler.shapes @ drift.mean(axis=0)
    drifted = rms(at_start)
    source: NoiseSource = "measured" if measured else "assumed"
    return Scatter(sd, tail, best.mean(axis=0), cell, expected, drifted, source, step_mm)


def _typical(away_mm: Array, least_mm: float) -> float:
    return max(2.0 * float(np.median(np.abs(away_mm))), least_mm) if len(away_mm) else least_mm


def _drift_shapes(t_s: Array) -> Array:
    """Polynomials in time (t, k, n, d) with zero mean over the run, scaled to the drift in mm of a real cell."""
    read = np.isfinite(t_s)
    begin, end = float(t_s[read].min()), float(t_s[read].max())
    x = np.where(read, 2 * (t_s - begin) / max(end - begin, 1e-9) - 1, 0.0)
    shapes = np.polynomial.legendre.legvander(x, _DRIFT_DEGREE)[..., 1:]
    shapes = np.where(read[..., None], shapes - shapes[read].mean(axis=0), 0.0)
    values: Array = shapes * DRIFT_MM_PER_S * (end - begin) / 2 / np.arange(1, _DRIFT_DEGREE + 1)
    return values


@dataclass
class _Sampler:
    """State of m Markov chains.

    variance (m, t): mm², of the scatter at each target. share (m, t, k, n): weight of each reading; outliers have a
    small weight. tail (m,): degrees of freedom of Student's t distribution of the errors. s0_sq and d0 (m,): common
    variance of all targets, and agreement of the targets with it. drift (m, d): coefficients of the drift shapes.
    """

    readings_mm: Array
    least_mm: float
    measured: bool
    t_s: Array | None
    step_mm: float
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(_SEED))

    def _cell_deviations(self, values: Array) -> Array:
        read = self.there[..., None]
        mean = np.where(read, values, 0.0).sum(axis=2, keepdims=True) / np.maximum(read.sum(axis=2, keepdims=True), 1)
        away: Array = np.where(read, values - mean, 0.0)
        return away

    def begin(self) -> None:
        self.there = np.isfinite(self.readings_mm)
        self.y = np.where(self.there, self.readings_mm, 0.0)
        self.chains = int(np.clip(_ELEMENTS // self.y.size, _FEWEST_CHAINS, _CHAINS))
        self.counts = self.there.sum(axis=(1, 2))
        self.shapes, self.first = np.zeros((*self.y.shape, _DRIFT_DEGREE)), np.unravel_index(0, self.y.shape)
        if self.t_s is not None:
            self.shapes = _drift_shapes(self.t_s)
            self.first = np.unravel_index(int(np.nanargmin(self.t_s)), self.y.shape)
        self.drift = np.zeros((self.chains, _DRIFT_DEGREE))
        self.d0 = self.rng.choice(_AGREEMENT, self.chains)
        self.tail = self.rng.choice(_TAILS, self.chains)
        self.share = np.broadcast_to(1.0 * self.there, (self.chains, *self.y.shape))
        away = self._cell_deviations(self.y[..., None])[..., 0]
        shapes = self._cell_deviations(self.shapes).reshape(-1, _DRIFT_DEGREE)
        again = np.broadcast_to(self.there.sum(axis=-1, keepdims=True) > 1, away.shape) & self.there
        typical = _typical(away[again], self.least_mm)
        normal = shapes.T @ shapes + typical**2 * np.eye(_DRIFT_DEGREE)
        away = away - (shapes @ np.linalg.solve(normal, shapes.T @ away.ravel())).reshape(away.shape)
        level = np.log(_typical(away[again], self.least_mm)) + self.rng.normal(0.0, 0.25, self.chains)
        if not self.measured:
            level = self.rng.uniform(np.log(TARGET_MM.low), np.log(TARGET_MM.high), self.chains)
        self.s0_sq = np.exp(2 * level)
        freedom = (self.there.sum(axis=-1) - 1).clip(min=0).sum(axis=1)
        chi2 = self.rng.chisquare(_FIRST_D0 + freedom, (self.chains, len(self.y)))
        self.variance = (_FIRST_D0 * self.s0_sq[:, None] + (away**2).sum(axis=(1, 2))) / chi2

    def sweep(self, level: Level) -> tuple[Array, Array]:
        """Draw all unknowns once; returns the expected values and draws (m, t, k) of the cells in mm."""
        weight = self.share / self.variance[:, :, None, None]
        total = weight.sum(axis=-1)
        y = self._without_drift(weight, total)
        mean = (weight * y).sum(axis=-1) / np.maximum(total, 1e-300)
        shared = shared_rounding(self.step_mm, np.maximum(self.variance - self.step_mm**2 / 12, 0.0))[..., None]
        best, cell = level(self.rng, total / (1 + total * shared), mean)
        # Tail, shares, variances, s0 and d0 are drawn in this order, from errors (m, t, k, n).
        error = np.where(self.there, y - self._read(cell, shared, total, mean)[..., None], 0.0)
        squares = error**2 / self.variance[:, :, None, None]
        fit = [self._tail_fit(squares, nu) for nu in _TAILS]
        self.tail = self._chosen(_TAILS, np.stack(fit, axis=1))
        nu = self.tail[:, None, None, None]
        self.share = self.rng.standard_gamma(np.broadcast_to((nu + 1) / 2, squares.shape)) * 2 / (nu + squares)
        self.share *= self.there
        spread = (self.share * error**2).sum(axis=(2, 3))
        chi2 = self.rng.chisquare(self.d0[:, None] + self.counts)
        self.variance = ((self.d0 * self.s0_sq)[:, None] + spread) / chi2
        self.variance = np.maximum(self.variance, self.least_mm**2)
        self._common()
        return best, cell

    def _read(self, cell: Array, shared: Array, total: Array, mean: Array) -> Array:
        """Average readings of the gauge at the cells (m, t, k), with a draw of the shared rounding error."""
        if self.step_mm == 0:
            return cell
        prior = shared / (1 + shared * total)
        drawn: Array = cell + prior * total * (mean - cell) + np.sqrt(prior) * self.rng.standard_normal(cell.shape)
        return drawn

    def _without_drift(self, weight: Array, total: Array) -> Array:
        """Readings minus a draw of the drift, which only differences between repeated readings determine."""
        if self.t_s is None:
            return np.broadcast_to(self.y, weight.shape)
        d = self.shapes.shape[-1]
        flat = self.shapes.reshape(-1, d)
        w = weight.reshape(self.chains, -1)
        sums = np.einsum("mtkn,tknd->mtkd", weight, self.shapes).reshape(self.chains, -1, d)
        means = sums / np.maximum(total, 1e-300).reshape(self.chains, -1, 1)
        seen = (w @ (flat[:, :, None] * flat[:, None, :]).reshape(-1, d * d)).reshape(self.chains, d, d)
        normal = seen - np.swapaxes(sums, 1, 2) @ means + np.eye(d)
        wy = (weight * self.y).sum(axis=-1).reshape(self.chains, -1, 1)
        right = w @ (flat * self.y.reshape(-1, 1)) - (means * wy).sum(axis=1)
        root = np.linalg.cholesky(np.linalg.inv(normal))
        kick = self.rng.standard_normal((self.chains, d, 1))
        self.drift = (np.linalg.solve(normal, right[..., None]) + root @ kick)[..., 0]
        return np.asarray(self.y - (self.drift @ flat.T).reshape(weight.shape))

    def _tail_fit(self, squares: Array, nu: float) -> Array:
        each = math.lgamma((nu + 1) / 2) - math.lgamma(nu / 2) - 0.5 * math.log(nu)
        logs: Array = np.log1p(squares / nu).sum(axis=(1, 2, 3))
        return float(self.counts.sum()) * each - (nu + 1) / 2 * logs

    def _common(self) -> None:
        count, inverse, logs = len(self.y), (1 / self.variance).sum(axis=1), np.log(self.variance).sum(axis=1)
        self.s0_sq = self.rng.standard_gamma(count * self.d0 / 2) * 2 / (self.d0 * inverse)
        if not self.measured:
            self.s0_sq = self.s0_sq.clip(TARGET_MM.low**2, TARGET_MM.high**2)
        half = _AGREEMENT / 2
        gammas = np.array([math.lgamma(value) for value in half])
        fit = count * (half * np.log(half * self.s0_sq[:, None]) - gammas)
        fit -= half * (logs + self.s0_sq * inverse)[:, None]
        self.d0 = self._chosen(_AGREEMENT, fit)

    def _chosen(self, values: Array, fit: Array) -> Array:
        """A value for each chain, with the probabilities of the log-likelihoods fit (m, values) (Gumbel's
        method)."""
        chosen: Array = values[np.argmax(fit + self.rng.gumbel(size=fit.shape), axis=1)]
        return chosen


_LEAST_MM2 = 1e-12
"""Smallest variance of errors, (1 nm)², which avoids a division by zero."""


class SphereLevel:
    """The `Level` of a hemisphere.

    For each of m chains: the tilt (m, o), the target error (m, t) excluding sphere and tilt, and the variances (m,) of
    both kinds of error.
    """

    @classmethod
    def at(cls, direction: Array, orientations: int) -> SphereLevel:
        design = np.column_stack([direction, np.ones(len(direction))])
        basis, s, _ = np.linalg.svd(design, full_matrices=False)
        return cls(basis[:, s > 1e-6 * s[0]] * np.sqrt(len(direction)), orientations == 1)

    def __init__(self, basis: Array, alone: bool) -> None:
        self._basis, self._alone = basis, alone
        self._begun = False
        self._tilt: Array
        self._target: Array
        self._target_mm2: Array
        self._orientation_mm2: Array

    def __call__(self, rng: np.random.Generator, weight: Array, mean: Array) -> tuple[Array, Array]:
        if not self._begun:
            # Initialise from plain means, with the noise known at this point subtracted.
            seen_cells = weight > 0
            self._target = (weight * mean).sum(axis=2) / weight.sum(axis=2)
            self._tilt = np.zeros((len(weight), weight.shape[2]))
            away = mean - self._target[..., None]
            self._orientation_mm2 = np.full(len(weight), _LEAST_MM2)
            if not self._alone:
                excess = (weight * away**2).sum(axis=(1, 2)) - (seen_cells.sum(axis=2) - 1).clip(min=0).sum(axis=1)
                self._orientation_mm2 = np.maximum(excess / weight.sum(axis=(1, 2)), _LEAST_MM2)
            off_sphere = self._target - self._target @ self._basis @ self._basis.T / len(self._basis)
            self._target_mm2 = np.maximum((off_sphere**2).mean(axis=1), _LEAST_MM2)
            self._begun = True
        across, along = self._orientation_mm2[:, None, None], self._target_mm2[:, None]
        precision = weight / (1 + weight * across)
        self._tilt_from(rng, precision, mean)
        level = mean - self._tilt[:, None, :]
        of_target = precision.sum(axis=2)
        seen = (precision * level).sum(axis=2) / np.maximum(of_target, 1e-300)
        sphere, moved = self._sphere(rng, of_target / (1 + of_target * along), seen)
        prior = 1 / along
        total = of_target + prior
        target = (of_target * seen + prior * sphere) / total
        shifted = prior * moved / total + rng.standard_normal(target.shape) / np.sqrt(total)
        prior = 1 / across
        total = weight + prior
        best = (weight * mean + prior * (target[..., None] + self._tilt[:, None, :])) / total
        cell = best + prior * shifted[..., None] / total + rng.standard_normal(best.shape) / np.sqrt(total)
        self._target = target + shifted
        residual = cell - self._target[..., None] - self._tilt[:, None, :]
        self._widths(rng, self._target - sphere - moved, residual * (weight > 0), weight)
        return best, cell

    def _tilt_from(self, rng: np.random.Generator, precision: Array, mean: Array) -> None:
        """Draw the tilt of each orientation. Their mean is zero, because a common part looks like errors of the
        targets.
        """
        if self._alone:
            return
        total = precision.sum(axis=1)
        best = (precision * (mean - self._target[..., None])).sum(axis=1) / total
        tilt = best + rng.standard_normal(best.shape) / np.sqrt(total)
        self._tilt = tilt - tilt.mean(axis=1, keepdims=True)

    def _sphere(self, rng: np.random.Generator, precision: Array, seen: Array) -> tuple[Array, Array]:
        """Distance (m, t) of the sphere at the targets, and the difference of a draw from it."""
        size = self._basis.shape[1]
        pairs = (self._basis[:, :, None] * self._basis[:, None, :]).reshape(-1, size * size)
        normal = (precision @ pairs).reshape(-1, size, size)
        best = np.linalg.solve(normal, ((precision * seen) @ self._basis)[..., None])
        kick = np.linalg.cholesky(np.linalg.inv(normal)) @ rng.standard_normal(best.shape)
        return best[..., 0] @ self._basis.T, kick[..., 0] @ self._basis.T

    def _widths(self, rng: np.random.Generator, target: Array, orientation: Array, weight: Array) -> None:
        count = target.shape[1]
        chi2 = rng.chisquare(max(count - 1, 1), len(target))
        self._target_mm2 = np.maximum((target**2).sum(axis=1) / chi2, _LEAST_MM2)
        if not self._alone:
            chi2 = rng.chisquare(max(int((weight[0] > 0).sum()) - 1, 1), len(target))
            self._orientation_mm2 = np.maximum((orientation**2).sum(axis=(1, 2)) / chi2, _LEAST_MM2)
