"""Estimation: the forward model is fitted to tables, always with set-up terms and with effects as requested, for
comparison, calibration and diagnosis.

Least squares on the readings themselves (mm), by scipy's trust region on the nonlinear simulator with numerical
derivatives. Readings are weighted by their noise, and parameters have a prior of plausible size.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from analysis.fitting.observation import Observation, residuals_of, rms
from analysis.fitting.setups import BALL_MM, columns_of, fit_setups, moved_setup
from analysis.fitting.weighting import Weighting, equal_weighting
from analysis.kinematics.arm import Array
from analysis.model.predict import Model, SetUp
from analysis.traces.tables import PoseTable, Table
from rigs.effects import Effect, bounds, healthy_size, size_field

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
            x[columns[:3]] / BALL_MM * self.unexplained
            for name, columns in self._columns.items()
            if not isinstance(self._table(name), PoseTable)
        ]
        return np.concatenate([*rows, x[len(self._owners) :] / self.weighting.spread])

    def _table(self, name: str) -> Table:
        return next(one.table for one in self.observations if one.setup == name)
