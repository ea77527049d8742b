"""The weighting of readings and parameters in a fit: the noise of runs, wild readings, and the levels of parameters.

Parameters have a zero-centred prior (ridge regression). Its width is the healthy size times a level, one for all
parameters of a kind, at which the data are most likely (MacKay, Neural Computation 4, 1992). A good arm has a level of
1, a bad one a level as large as its errors. The prior does not change what the readings determine. What they do not
distinguish is shared among the parameters with the same response, in proportion to their plausible variance.

The noise is that of the residual of the fit, never that before it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analysis.fitting.observation import Observation
from analysis.fitting.run_noise import RunResiduals, correlation_length, repeats_of, setup_noise_mm, soundness
from analysis.kinematics.arm import Array
from analysis.noise.cell import TARGET_MM
from analysis.noise.readings import is_wild
from analysis.traces.tables import CircleTable
from rigs.effects import Effect

if TYPE_CHECKING:
    from analysis.fitting.estimate import Fit

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
