"""Estimation of given parameters: the noise of runs from residuals, weights, and the fit of the forward model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from analysis.inference.observation import Observation, residuals_of, rms
from analysis.inference.setups import BALL_PRIOR_MM, columns_of, fit_setups, moved_setup
from analysis.kinematics.arm import Array
from analysis.measures.pose import SAME_RAD, groups
from analysis.model.predict import Model, SetUp
from analysis.noise.cell import TARGET_MM, WHITE_MM
from analysis.noise.readings import is_wild
from analysis.traces.tables import CircleTable, PoseTable, RepeatabilityTable, Table
from rigs.effects import Effect, bounds, healthy_size, size_field

# ----------------------------------------------------------------------------------------------------------------------
# The noise of runs from the residuals of a fit, at the fit's degrees of freedom, and the classification of wild
# readings.
#
# The runs of a set-up share one level. Their differences are smooth along a lap and can be fitted, so a run with a
# noise of its own would draw the fit to itself. A reading is sound or wild by the odds of two normal distributions
# (Tukey's contaminated normal), of which the wild one is many times wider.

_WILD_SHARE, _WILDER = 0.01, 30.0
"""Prior share of wild readings, and the ratio of their scatter to that of the others: outliers of real cells are 10 to
100 standard deviations, with a geometric mean of about 30."""
_TAILS = 1.5
"""Factor by which sound readings are taken to be wider than their median implies. Chosen: stops of real robots, and
unmodelled effects, have heavier tails than a normal distribution."""
_KNOWN_FREEDOM = 3.0
"""Degrees of freedom of the noise of repeats, or of the assumed noise, beside that of the residual, which also contains
unmodelled effects. Chosen: one pose."""
_FEWEST_REPEATS = 3
"""Degrees of freedom below which repeats are not used. Chosen: one repeated pose."""
LAG_S = 2.5
"""Separation in time beyond which residuals are taken to be uncorrelated. Chosen: slow noise of real cells has
correlation times of 0.1 to 5 s."""
_MEDIAN_CHI2 = {1: 0.4549, 2: 1.3863, 3: 2.3660}
"""The median of chi-square for one, two and three degrees of freedom."""


@dataclass(frozen=True)
class Repeats:
    """The scatter of repeats: `sd_mm` is the standard deviation of one coordinate of one visit, with `freedom` degrees
    of freedom."""

    sd_mm: float
    freedom: int


def soundness(residual: Array, leverage: Array) -> Array:
    """Return how sound each reading is, between 0 and 1, with the same value for all coordinates (m, k) of a pose, by
    its distance relative to the noise of the others."""
    coordinates = residual.shape[1]
    distance = (residual**2 / (1 - leverage)).sum(axis=1)
    variance = max(float(np.median(distance)) / _MEDIAN_CHI2[coordinates], WHITE_MM.low**2)
    distance /= _TAILS**2 * variance
    normal = np.log1p(-_WILD_SHARE) - distance / 2
    wild = np.log(_WILD_SHARE) - coordinates * np.log(_WILDER) - distance / (2 * _WILDER**2)
    share: Array = 1 / (1 + np.exp(np.clip(wild - normal, -700, 700)))
    return np.broadcast_to(share[:, None], residual.shape)


@dataclass(frozen=True)
class RunResiduals:
    """A run's contribution to the noise of a set-up: residual (m, k) mm, leverage (m, k), soundness (m, k), and the
    number of neighbouring readings that carry the information of one."""

    residual: Array
    leverage: Array
    sound: Array
    correlation_length: float


def setup_noise_mm(parts: Sequence[RunResiduals], repeats: Repeats | None, usual_mm: float = TARGET_MM.middle) -> float:
    """Return the noise of the runs of a set-up from their residuals (m, k) mm, combined with the scatter of repeats, or
    with a usual value where readings are few. It is scaled so that correlated readings have the weight of the
    information that they contain."""
    freedom = sum(float((part.sound - part.leverage).clip(min=0).sum()) / part.correlation_length for part in parts)
    squares = sum(float((part.sound * part.residual**2).sum()) / part.correlation_length for part in parts)
    known_mm = repeats.sd_mm if repeats else usual_mm
    level = float(np.sqrt((squares + _KNOWN_FREEDOM * known_mm**2) / (freedom + _KNOWN_FREEDOM)))
    if repeats:
        level = max(level, repeats.sd_mm)
    correlation_length = float(
        np.average([part.correlation_length for part in parts], weights=[part.residual.size for part in parts])
    )
    return max(level, WHITE_MM.low) * float(np.sqrt(correlation_length))


def correlation_length(one: Observation, residual: Array) -> float:
    """Return how many neighbouring readings of a lap carry the information of one, from the residual (m, k) mm: the
    ratio of the variance of a mean to that of white noise."""
    if not isinstance(one.table, CircleTable):
        return 1.0
    step_s = float(np.median(np.diff(one.table.t_s[one.rows])))
    lags = max(1, min(len(residual) // 4, int(LAG_S / max(step_s, 1e-6))))
    spectrum = np.fft.rfft(residual - residual.mean(axis=0), n=2 * len(residual), axis=0)
    likeness = np.fft.irfft(np.abs(spectrum) ** 2, axis=0)[: lags + 1].sum(axis=1)
    bartlett = 1 - np.arange(lags + 1) / (lags + 1)
    return max(1.0, float(2 * bartlett @ likeness / max(float(likeness[0]), 1e-300)) - 1.0)


def repeats_of(observations: Sequence[Observation], residuals: Sequence[Array]) -> dict[str, Repeats]:
    """Return the scatter of visits of the same place from the same side, for each set-up that has any, from residuals
    (m, k) mm."""
    parts: dict[str, list[tuple[float, int]]] = {}
    for one, residual in zip(observations, residuals, strict=True):
        if isinstance(one.table, CircleTable):
            continue
        q = one.table.q[one.rows]
        if isinstance(one.table, RepeatabilityTable):
            q = np.column_stack([q, np.unique(one.table.approach[one.rows], return_inverse=True)[1]])
        group = groups(q, SAME_RAD)
        for number in np.flatnonzero(np.bincount(group) > 1):
            own = residual[group == number]
            freedom = (len(own) - 1) * own.shape[1]
            parts.setdefault(one.setup, []).append((float(((own - own.mean(axis=0)) ** 2).sum()), freedom))
    return {setup: _pooled(own) for setup, own in parts.items() if sum(n for _, n in own) >= _FEWEST_REPEATS}


def _pooled(parts: Sequence[tuple[float, int]]) -> Repeats:
    """Return the scatter from the median over the places, so that a wild visit has no influence."""
    squares, freedom = np.array(parts).T
    median = (1 - 2 / (9 * freedom)) ** 3  # of chi square over its degrees of freedom (Wilson and Hilferty 1931)
    typical = float(np.median(squares / freedom / median))
    return Repeats(max(float(np.sqrt(typical)), WHITE_MM.low), int(freedom.sum()))


# ----------------------------------------------------------------------------------------------------------------------
# The weighting of readings and parameters in a fit: the noise of runs, wild readings, and the levels of parameters.
#
# Parameters have a zero-centred prior (ridge regression). Its width is the healthy size times a level, one for all
# parameters of a kind, at which the data are most likely (MacKay, Neural Computation 4, 1992). A good arm has a level
# of 1, a bad one a level as large as its errors. The prior does not change what the readings determine. What they do
# not distinguish is shared among the parameters with the same response, in proportion to their plausible variance.
#
# The noise is that of the residual of the fit, never that before it.

LEVELS = (1.0, 100.0)
"""Range of the levels of parameters, in healthy sizes: every arm has at least the errors of a healthy one, and faults
are 5 to 100 healthy sizes."""
_BAD = 30.0
"""The level at which a calibration starts. Chosen: that of a bad arm, so that the first fit is hardly restricted."""
_MOST_LEVERAGE = 0.9
"""Largest leverage of a reading. Chosen: a reading that determines the fit by more contains no information about its
own noise."""
SOUND = 0.5
"""Soundness below which a reading is wild: equal odds."""
_TURNS, _CONVERGED = 50, 1e-3
"""Largest number of iterations of the levels, and the relative change below which they end. Chosen: far below the
uncertainty of a level."""


@dataclass(frozen=True)
class Weighting:
    """The weights of a fit. `noise_mm` is the standard deviation of a sound reading of each observation, increased for
    correlated neighbours; `sound` has, for each observation, (m, k) between 0 for a wild reading and 1; `spread` (p,)
    is the prior standard deviation of the free parameters in healthy sizes."""

    noise_mm: tuple[float, ...]
    sound: tuple[Array, ...]
    spread: Array

    @property
    def weights(self) -> list[Array]:
        """The weights (m, k) per mm of the readings of each observation."""
        return [np.sqrt(sound) / noise for sound, noise in zip(self.sound, self.noise_mm, strict=True)]

    def weighted(self, residuals: Sequence[Array]) -> list[Array]:
        """Return residuals (m, k) mm of all observations as multiples of their noise."""
        return [weight * residual for weight, residual in zip(self.weights, residuals, strict=True)]

    @property
    def wild(self) -> tuple[int, ...]:
        """The number of readings of each observation that are effectively left out; a pose is one reading."""
        return tuple(int((sound.min(axis=1) < SOUND).sum()) for sound in self.sound)


def equal_weighting(observations: Sequence[Observation], parameters: int) -> Weighting:
    """Return equal weights of 1 per mm for all readings (m, k), and parameters without a prior."""
    sound = tuple(np.ones(one.values.shape) for one in observations)
    return Weighting((1.0,) * len(observations), sound, np.full(parameters, np.inf))


def initial_weighting(observations: Sequence[Observation], parameters: int) -> Weighting:
    """Return the weighting at the start of a calibration: the noise of real cells, the parameters of a bad arm, and
    circles, of (m, k) mm, without readings that their neighbours show to be wild."""
    sound = tuple(_beside_neighbours(one) for one in observations)
    return Weighting((TARGET_MM.middle,) * len(observations), sound, np.full(parameters, _BAD))


def _beside_neighbours(one: Observation) -> Array:
    """Return 0 for a reading of a circle that differs from its neighbours, and 1 otherwise, (m, k)."""
    sound = np.ones(one.values.shape)
    if isinstance(one.table, CircleTable):
        sound[np.stack([is_wild(column) for column in one.values.T], axis=1)] = 0.0
    return sound


def updated_weighting(weighting: Weighting, found: Fit, observations: Sequence[Observation]) -> Weighting:
    """Return the weighting that the residuals (m, k) mm of a fit imply."""
    rows = sum(one.values.size for one in observations)
    leverage = _leverage(found.design, rows)
    parts: dict[str, list[RunResiduals]] = {}
    sound: list[Array] = []
    begin = 0
    for k, (one, residual) in enumerate(zip(observations, found.residuals, strict=True)):
        own = leverage[begin : begin + residual.size].reshape(residual.shape)
        begin += residual.size
        sound.append(weighting.sound[k] if isinstance(one.table, CircleTable) else soundness(residual, own))
        parts.setdefault(one.setup, []).append(
            RunResiduals(residual, own, sound[-1], correlation_length(one, residual))
        )
    repeats = repeats_of(observations, found.residuals)
    noise = []
    for one in observations:
        alike = {other.setup for other in observations if type(other.table) is type(one.table)}
        usual = setup_noise_mm([part for setup in alike for part in parts[setup]], None)
        noise.append(setup_noise_mm(parts[one.setup], repeats.get(one.setup), usual))
    kinds = [_kind(found.model.effects[one.effect], one.field) for one in found.free]
    size = np.array([one.scale for one in found.free])
    return Weighting(tuple(noise), tuple(sound), _spread(found.design, found.values / size, weighting, kinds))


def relative_change(one: Weighting, other: Weighting) -> float:
    """Return the largest relative change of a noise or a level, and infinity where a reading is wild in only one of
    them."""
    if one.wild != other.wild:
        return float("inf")
    ratio = np.concatenate([np.divide(one.noise_mm, other.noise_mm), one.spread / other.spread])
    return float(np.abs(np.log(ratio)).max())


def resolution(design: Array, spread: Array) -> Array:
    """Return the response (p, p) of a fit to each parameter, in spreads, from its design (N + rows of the priors, terms
    + p); it is the unit matrix where the data determine all parameters."""
    scaled = _information(design, len(spread)) * np.outer(spread, spread)
    return np.asarray(np.linalg.solve(scaled + np.eye(len(spread)), scaled))


def _information(design: Array, parameters: int) -> Array:
    """Return the information (p, p) of the readings about the parameters, with the set-up terms fitted."""
    terms = design.shape[1] - parameters
    # The prior of the ball belongs to the set-up; the last rows are the prior of the parameters.
    J = design[: len(design) - parameters]
    basis, size, _ = np.linalg.svd(J[:, :terms], full_matrices=False)
    basis = basis[:, size > 1e-9 * size[0]]
    own = J[:, terms:] - basis @ (basis.T @ J[:, terms:])
    information: Array = own.T @ own
    return information


def _leverage(design: Array, rows: int) -> Array:
    """Return the leverage (rows,) of each reading, 0 to 1."""
    size = np.maximum(np.linalg.norm(design, axis=0), 1e-300)
    J = design / size
    inverse = np.linalg.pinv(J.T @ J, rcond=1e-12, hermitian=True)
    share: Array = np.sum(J[:rows] @ inverse * J[:rows], axis=1)
    return np.clip(share, 0.0, _MOST_LEVERAGE)


def _kind(effect: Effect, field: str) -> tuple[str, bool]:
    """Return the kind of a parameter. Parameters of one kind share a level: those of one effect, with lengths and
    angles separate."""
    return effect.effect, getattr(effect, "field", field) in ("alpha", "beta")


def _spread(design: Array, values: Array, weighting: Weighting, kinds: Sequence[tuple[str, bool]]) -> Array:
    """Return the most likely levels (p,), at which the mean square of the determined values equals that of the prior.

    The iteration starts at the lowest level, because there may be several solutions: a parameter that is hardly
    determined may always have been large.
    """
    H = _information(design, len(values))
    pull = H @ values + values / weighting.spread**2
    spread = np.full(len(values), LEVELS[0])
    for _ in range(_TURNS):
        covariance = np.linalg.inv(H + np.diag(1 / spread**2))
        mean = covariance @ pull
        determined = 1 - np.diag(covariance) / spread**2
        before, spread = spread, spread.copy()
        for kind in set(kinds):
            own = [k for k, other in enumerate(kinds) if other == kind]
            level = float(np.sqrt((mean[own] ** 2).sum() / max(float(determined[own].sum()), 1e-9)))
            spread[own] = min(max(level, LEVELS[0]), LEVELS[1])
        converged = np.abs(np.log(spread / before)).max() < _CONVERGED
        if converged:
            break
    return spread


# ----------------------------------------------------------------------------------------------------------------------
# Estimation: the forward model is fitted to tables, always with set-up terms and with effects as requested, for
# comparison, calibration and diagnosis.
#
# Least squares on the readings themselves (mm), by scipy's trust region on the nonlinear simulator with numerical
# derivatives. Readings are weighted by their noise, and parameters have a prior of plausible size.

_INSIDE = 0.5
"""Distance from its bounds, in plausible sizes, at which a bounded size starts. Chosen: half a healthy size, where
every effect has a slope."""


@dataclass(frozen=True)
class FreeParameter:
    """One free parameter of one effect: the index of the effect, its field, and its plausible size."""

    effect: int
    field: str
    scale: float
    signed: bool = False
    """Whether it is the sine or cosine part of a wave, which may be negative, while the amplitude of a whole wave may
    not."""


def sizes(effects: Sequence[Effect]) -> list[FreeParameter]:
    """Return the size of each effect as a free parameter."""
    return [FreeParameter(k, size_field(effect), healthy_size(effect)) for k, effect in enumerate(effects)]


@dataclass(frozen=True)
class Fit:
    """A fitted model.

    `model` contains the fitted effects and `setups` the fitted set-ups by name. `residuals` are (m, k) mm for each
    observation; `values` (p,) those of the free parameters in file units. `unknowns` (terms + p,) are changes of the
    set-up terms (mm) and then the parameters in plausible sizes. `design` (N + rows of the priors, terms + p) has the
    derivatives of all weighted residuals by the unknowns at the solution.
    """

    model: Model
    setups: dict[str, SetUp]
    residuals: list[Array]
    free: tuple[FreeParameter, ...]
    values: Array
    unknowns: Array
    design: Array

    @property
    def rms_mm(self) -> float:
        """Root mean square of all residuals; for poses of the distance, as is usual."""
        return rms(self.residuals)


def fit(
    model: Model,
    observations: Sequence[Observation],
    free: Sequence[FreeParameter] = (),
    setups: Mapping[str, SetUp] | None = None,
    weighting: Weighting | None = None,
    near: Fit | None = None,
) -> Fit:
    """Return the fit of set-up terms and of the free parameters of the model's effects to readings (m, k) mm.

    `weighting` applies to readings and parameters; without it all readings have equal weight and parameters have no
    prior. `near` is a fit of the same problem with another weighting. `setups` are the starting values; by default they
    are fitted to the model as it is, because the prior of a ball far from its place would hold it back, and effects
    would compensate for that.
    """
    from scipy.optimize import least_squares  # noqa: PLC0415 - slow to import, needed here only

    weighting = weighting or equal_weighting(observations, len(free))
    placed = dict(setups or fit_setups([(model, one) for one in observations]))
    problem = _Problem(model, observations, tuple(free), placed, weighting)
    problem = replace(problem, unexplained=problem.after_one_step())
    start = problem.start() if near is None else near.unknowns.copy()
    low, high = problem.bounds(start)
    found = least_squares(problem.residual, start, bounds=(low, high), x_scale="jac", jac=problem.jacobian)
    fitted, placed = problem.at(found.x)
    residuals = residuals_of(fitted, observations, placed)
    first = len(start) - len(problem.free)
    scale = np.array([one.scale for one in problem.free])
    values: Array = np.asarray(found.x[first:] * scale, dtype=float)
    design = np.asarray(found.jac)
    return Fit(fitted, placed, residuals, problem.free, values, found.x, design)


@dataclass(frozen=True)
class _Problem:
    """The vector of unknowns and its meaning: set-up terms by name, then free parameters in plausible sizes.

    unexplained: the norm of all weighted residuals that a ball as far off as its prior allows costs.
    """

    model: Model
    observations: Sequence[Observation]
    free: tuple[FreeParameter, ...]
    setups: dict[str, SetUp]
    weighting: Weighting
    unexplained: float = 0.0

    @cached_property
    def _columns(self) -> dict[str, list[int]]:
        return columns_of({name: self._table(name) for name in self.setups})

    @cached_property
    def _owners(self) -> list[set[str]]:
        """The set-ups that each term belongs to."""
        return [
            {name for name, columns in self._columns.items() if k in columns}
            for k in range(1 + max(max(columns) for columns in self._columns.values()))
        ]

    def start(self) -> Array:
        """Return the starting vector (u,), in the units of the rig file (mm, degrees): zero changes of the set-up
        terms, and the parameters of the model."""
        own = [getattr(self.model.effects[one.effect], one.field) / one.scale for one in self.free]
        return np.concatenate([np.zeros(len(self._owners)), np.array(own, dtype=float)])

    def bounds(self, start: Array) -> tuple[Array, Array]:
        """Return the lower and upper bounds (u,) of the unknowns, in the units of the rig file (mm, degrees), and move
        the start inside them."""
        low, high = np.full(len(start), -np.inf), np.full(len(start), np.inf)
        first = len(start) - len(self.free)
        for k, one in enumerate(self.free, start=first):
            if one.signed:
                continue
            low[k], high[k] = (bound / one.scale for bound in bounds(self.model.effects[one.effect], one.field))
            # The trust region cannot start on a bound, and some effects have no slope at zero.
            start[k] = np.clip(start[k], low[k] + _INSIDE, high[k] - _INSIDE)
        return low, high

    def at(self, x: Array) -> tuple[Model, dict[str, SetUp]]:
        """Return the model and set-ups of a vector of unknowns (u,), mm or degrees each."""
        placed = {
            name: moved_setup(self.setups[name], self._table(name), x[columns])
            for name, columns in self._columns.items()
        }
        effects = list(self.model.effects)
        for one, value in zip(self.free, x[len(self._owners) :], strict=True):
            effects[one.effect] = effects[one.effect].model_copy(update={one.field: float(value * one.scale)})
        return replace(self.model, effects=tuple(effects)), placed

    def residual(self, x: Array) -> Array:
        """Return the residuals and the priors in standard deviations, (N + rows of the priors,), at unknowns x (u,)."""
        model, placed = self.at(x)
        parts = self.weighting.weighted(residuals_of(model, self.observations, placed))
        return np.concatenate([*(part.ravel() for part in parts), self._prior(x)])

    def jacobian(self, x: Array) -> Array:
        """Return the derivatives (N + rows of the priors, u) by differences, in standard deviations per mm or degree;
        a set-up term affects only the tables of its own set-up."""
        model, placed = self.at(x)
        base = residuals_of(model, self.observations, placed)
        rows = np.concatenate([[0], np.cumsum([residual.size for residual in base])])
        J = np.zeros((int(rows[-1]) + len(self._prior(x)), len(x)))
        for k in range(len(x)):
            step = np.zeros(len(x))
            # Set-up terms are mm; parameters are in plausible sizes. A step of a thousandth suits both; it goes
            # upwards, where no bound is close: upper ones are hundreds of plausible sizes away.
            step[k] = 1e-3
            model, placed = self.at(x + step)
            for place, one in enumerate(self.observations):
                if k >= len(self._owners) or one.setup in self._owners[k]:
                    (changed,) = residuals_of(model, [one], placed)
                    change = self.weighting.weights[place] * (changed - base[place]) / step[k]
                    J[rows[place] : rows[place + 1], k] = change.ravel()
            J[rows[-1] :, k] = (self._prior(x + step) - self._prior(x)) / step[k]
        return J

    def after_one_step(self) -> float:
        """Return the norm of all weighted residuals after one linear step from the start."""
        start = self.start()
        residual, J = self.residual(start), self.jacobian(start)
        step = np.linalg.lstsq(J, -residual, rcond=1e-4)[0]
        return float(np.linalg.norm(residual + J @ step))

    def _prior(self, x: Array) -> Array:
        rows = [
            x[columns[:3]] / BALL_PRIOR_MM * self.unexplained
            for name, columns in self._columns.items()
            if not isinstance(self._table(name), PoseTable)
        ]
        return np.concatenate([*rows, x[len(self._owners) :] / self.weighting.spread])

    def _table(self, name: str) -> Table:
        return next(one.table for one in self.observations if one.setup == name)
