"""Fitting the forward model to tables: set-up terms always, effects as asked; for comparison, calibration, diagnosis.

Least squares on the readings themselves (mm), by scipy's trust region on the nonlinear simulator, with numerical
derivatives. Readings are weighed by their noise, and parameters held by how large they plausibly are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.fitting.observation import Observation, residuals_of, rms
from analysis.fitting.setups import BALL_MM, columns_of, moved_setup, settled
from analysis.fitting.weighing import Weighing, equal
from analysis.kinematics.arm import Array
from analysis.model.predict import Model, SetUp
from analysis.traces.tables import PoseTable, Table
from rigs.effects import Effect, bounds, healthy_size, size_field

_INSIDE = 0.5
"""A bounded size begins at least this many plausible sizes inside its bounds."""


@dataclass(frozen=True)
class Free:
    """One free parameter of one effect: which of the model's effects, which field, and its plausible size."""

    effect: int
    field: str
    scale: float
    signed: bool = False
    """Half of a wave (its sine or cosine part), which may be negative where the amplitude of a whole one may not."""


def sizes(effects: Sequence[Effect]) -> list[Free]:
    """The size of each effect as a free parameter."""
    return [Free(k, size_field(effect), healthy_size(effect)) for k, effect in enumerate(effects)]


@dataclass(frozen=True)
class Fit:
    """A fitted model.

    model: with the fitted effects; setups: fitted, by name; residuals: per observation (m, k) mm; values (p,) of the
    free parameters in file units; unknowns (terms + p,): changes of the set-up terms (mm), then the parameters in
    plausible sizes; design (N + rows of the priors, terms + p): derivatives of all weighed residuals by those, at the
    end; rms_mm over all residuals.
    """

    model: Model
    setups: dict[str, SetUp]
    residuals: list[Array]
    free: tuple[Free, ...]
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
    free: Sequence[Free] = (),
    setups: Mapping[str, SetUp] | None = None,
    weighing: Weighing | None = None,
    near: Fit | None = None,
) -> Fit:
    """Fit set-up terms, and the free parameters of the model's effects.

    weighing: of readings and parameters; without it all readings count alike and parameters are held by nothing.
    near: a fit of the same that was weighed otherwise.

    setups: where to begin; else at set-ups that fit the model as it is: far from its place a ball would be held
    back by a prior that knows only the straight part of what the readings say, and effects would make up for it.
    """
    from scipy.optimize import least_squares  # noqa: PLC0415 - slow to import, needed here only

    weighing = weighing or equal(observations, len(free))
    placed = dict(setups or settled([(model, one) for one in observations]))
    problem = _Problem(model, observations, tuple(free), placed, weighing)
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


class _Problem:
    """The vector of unknowns and what it means: set-up terms by name, then free parameters in plausible sizes."""

    def __init__(
        self,
        model: Model,
        observations: Sequence[Observation],
        free: tuple[Free, ...],
        setups: dict[str, SetUp],
        weighing: Weighing,
    ) -> None:
        self.model, self.observations, self.free, self.setups = model, observations, free, setups
        self.weighing = weighing
        self._columns = columns_of({name: self._table(name) for name in setups})
        self._owners = [
            {name for name, columns in self._columns.items() if k in columns}
            for k in range(1 + max(max(columns) for columns in self._columns.values()))
        ]
        self._unexplained = 0.0
        self._unexplained = self._after_one_step(self.start())

    def start(self) -> Array:
        """Set-up terms as changes from where they begin, so zeros; parameters as they are in the model."""
        own = [getattr(self.model.effects[one.effect], one.field) / one.scale for one in self.free]
        return np.concatenate([np.zeros(len(self._owners)), np.array(own, dtype=float)])

    def bounds(self, start: Array) -> tuple[Array, Array]:
        low, high = np.full(len(start), -np.inf), np.full(len(start), np.inf)
        first = len(start) - len(self.free)
        for k, one in enumerate(self.free, start=first):
            if one.signed:
                continue
            low[k], high[k] = (bound / one.scale for bound in bounds(self.model.effects[one.effect], one.field))
            # On a bound the trust region has no room to begin with, and some effects have no slope at zero.
            start[k] = np.clip(start[k], low[k] + _INSIDE, high[k] - _INSIDE)
        return low, high

    def at(self, x: Array) -> tuple[Model, dict[str, SetUp]]:
        """Model and set-ups of a vector of unknowns."""
        placed = {
            name: moved_setup(self.setups[name], self._table(name), x[columns])
            for name, columns in self._columns.items()
        }
        effects = list(self.model.effects)
        for one, value in zip(self.free, x[len(self._owners) :], strict=True):
            effects[one.effect] = effects[one.effect].model_copy(update={one.field: float(value * one.scale)})
        return replace(self.model, effects=tuple(effects)), placed

    def residual(self, x: Array) -> Array:
        model, placed = self.at(x)
        parts = self.weighing.weighed(residuals_of(model, self.observations, placed))
        return np.concatenate([*(part.ravel() for part in parts), self._prior(x)])

    def jacobian(self, x: Array) -> Array:
        """Derivatives by differences; a set-up term is only looked for in the tables of its own set-up."""
        model, placed = self.at(x)
        base = residuals_of(model, self.observations, placed)
        rows = np.concatenate([[0], np.cumsum([residual.size for residual in base])])
        J = np.zeros((int(rows[-1]) + len(self._prior(x)), len(x)))
        for k in range(len(x)):
            step = np.zeros(len(x))
            # Set-up terms are mm; parameters are in plausible sizes. Both are happy with a thousandth, upwards,
            # where no bound is: upper ones are hundreds of plausible sizes away.
            step[k] = 1e-3
            model, placed = self.at(x + step)
            for place, one in enumerate(self.observations):
                if k >= len(self._owners) or one.setup in self._owners[k]:
                    (changed,) = residuals_of(model, [one], placed)
                    change = self.weighing.weights[place] * (changed - base[place]) / step[k]
                    J[rows[place] : rows[place + 1], k] = change.ravel()
            J[rows[-1] :, k] = (self._prior(x + step) - self._prior(x)) / step[k]
        return J

    def _after_one_step(self, start: Array) -> float:
        """What one linear step leaves, over all weighed readings: a ball as far off as its prior costs as much."""
        residual, J = self.residual(start), self.jacobian(start)
        step = np.linalg.lstsq(J, -residual, rcond=1e-4)[0]
        return float(np.linalg.norm(residual + J @ step))

    def _prior(self, x: Array) -> Array:
        rows = [
            x[columns[:3]] / BALL_MM * self._unexplained
            for name, columns in self._columns.items()
            if not isinstance(self._table(name), PoseTable)
        ]
        return np.concatenate([*rows, x[len(self._owners) :] / self.weighing.spread])

    def _table(self, name: str) -> Table:
        return next(one.table for one in self.observations if one.setup == name)
