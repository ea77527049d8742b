"""How much each reading and each parameter counts in a fit: noise of runs, wild readings, levels of parameters.

Parameters are held by a prior of zero mean (ridge regression): its width is the healthy size times a level, one for
all parameters of a kind, at which the data are likeliest (MacKay, Neural Computation 4, 1992). A good arm has a level
of 1, a bad one as large as its errors. What the readings tell is not touched by it; what they do not tell apart is
shared among those that do the same, each as far as it is plausibly large.

The noise is what the fit leaves and never the gap before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analysis.fitting.observation import Observation
from analysis.fitting.run_noise import RunShare, memory_of, noise_of, repeats_of, soundness
from analysis.kinematics.arm import Array
from analysis.noise.cell import TARGET_MM
from analysis.noise.readings import is_wild
from analysis.traces.tables import CircleTable
from rigs.effects import Effect

if TYPE_CHECKING:
    from analysis.fitting.estimate import Fit

LEVELS = (1.0, 100.0)
"""Of parameters, in healthy sizes: every arm is healthy at the best, and faults are 5 to 100 healthy sizes."""
_BAD = 30.0
"""The level of a bad arm, with which a calibration begins."""
_MOST_LEVERAGE = 0.9
"""A reading that the fit follows more than that shows nothing of its own noise."""
SOUND = 0.5
"""A reading less sound than that is wild."""
_TURNS, _SETTLED = 50, 1e-3
"""Of finding the levels, and the relative change that matters no more."""


@dataclass(frozen=True)
class Weighing:
    """noise_mm: standard deviation of a sound reading of each observation, the larger the more neighbours it is like;
    sound: for each observation (m, k), between 0 for a wild reading and 1; spread (p,): standard deviations of the free
    parameters beforehand, in healthy sizes."""

    noise_mm: tuple[float, ...]
    sound: tuple[Array, ...]
    spread: Array

    @property
    def weights(self) -> list[Array]:
        """(m, k) per mm of each observation."""
        return [np.sqrt(sound) / noise for sound, noise in zip(self.sound, self.noise_mm, strict=True)]

    def weighed(self, residuals: Sequence[Array]) -> list[Array]:
        """Residuals (m, k) mm of all observations as multiples of their noise."""
        return [weight * residual for weight, residual in zip(self.weights, residuals, strict=True)]

    @property
    def wild(self) -> tuple[int, ...]:
        """How many readings of each observation are left out, in effect; a pose is one reading."""
        return tuple(int((sound.min(axis=1) < SOUND).sum()) for sound in self.sound)


def equal(observations: Sequence[Observation], parameters: int) -> Weighing:
    """All readings alike, each millimetre a millimetre, and parameters held by nothing."""
    sound = tuple(np.ones(one.values.shape) for one in observations)
    return Weighing((1.0,) * len(observations), sound, np.full(parameters, np.inf))


def begun(observations: Sequence[Observation], parameters: int) -> Weighing:
    """What a calibration begins with: noise as of real cells, parameters of a bad arm, circles without what their
    neighbours show to be wild."""
    sound = tuple(_beside_neighbours(one) for one in observations)
    return Weighing((TARGET_MM.middle,) * len(observations), sound, np.full(parameters, _BAD))


def _beside_neighbours(one: Observation) -> Array:
    """0 for what leaves its neighbours on a circle, else 1."""
    sound = np.ones(one.values.shape)
    if isinstance(one.table, CircleTable):
        sound[np.stack([is_wild(column) for column in one.values.T], axis=1)] = 0.0
    return sound


def renewed(weighing: Weighing, found: Fit, observations: Sequence[Observation]) -> Weighing:
    """The same as a fit made with it shows it to be."""
    rows = sum(one.values.size for one in observations)
    leverage = _leverage(found.design, rows)
    parts: dict[str, list[RunShare]] = {}
    sound: list[Array] = []
    begin = 0
    for k, (one, residual) in enumerate(zip(observations, found.residuals, strict=True)):
        own = leverage[begin : begin + residual.size].reshape(residual.shape)
        begin += residual.size
        sound.append(weighing.sound[k] if isinstance(one.table, CircleTable) else soundness(residual, own))
        parts.setdefault(one.setup, []).append(RunShare(residual, own, sound[-1], memory_of(one, residual)))
    repeats = repeats_of(observations, found.residuals)
    noise = []
    for one in observations:
        alike = {other.setup for other in observations if type(other.table) is type(one.table)}
        usual = noise_of([part for setup in alike for part in parts[setup]], None)
        noise.append(noise_of(parts[one.setup], repeats.get(one.setup), usual))
    kinds = [_kind(found.model.effects[one.effect], one.field) for one in found.free]
    size = np.array([one.scale for one in found.free])
    return Weighing(tuple(noise), tuple(sound), _spread(found.design, found.values / size, weighing, kinds))


def apart(one: Weighing, other: Weighing) -> float:
    """The largest relative change of a noise or a level, infinite where a reading is wild in one only."""
    if one.wild != other.wild:
        return float("inf")
    ratio = np.concatenate([np.divide(one.noise_mm, other.noise_mm), one.spread / other.spread])
    return float(np.abs(np.log(ratio)).max())


def resolution(design: Array, spread: Array) -> Array:
    """(p, p): how a fit answers to each parameter, in spreads; the unit matrix where the data tell all of them."""
    scaled = _information(design, len(spread)) * np.outer(spread, spread)
    return np.asarray(np.linalg.solve(scaled + np.eye(len(spread)), scaled))


def _information(design: Array, parameters: int) -> Array:
    """What the readings say of the parameters (p, p), the set-up terms fitted."""
    terms = design.shape[1] - parameters
    # The prior of the ball belongs to the set-up; that of the parameters stands in the last rows.
    J = design[: len(design) - parameters]
    basis, size, _ = np.linalg.svd(J[:, :terms], full_matrices=False)
    basis = basis[:, size > 1e-9 * size[0]]
    own = J[:, terms:] - basis @ (basis.T @ J[:, terms:])
    information: Array = own.T @ own
    return information


def _leverage(design: Array, rows: int) -> Array:
    """How far each of the readings (rows,) draws the fit to itself, 0 to 1."""
    size = np.maximum(np.linalg.norm(design, axis=0), 1e-300)
    J = design / size
    inverse = np.linalg.pinv(J.T @ J, rcond=1e-12, hermitian=True)
    share: Array = np.einsum("ij,jk,ik->i", J[:rows], inverse, J[:rows])
    return np.clip(share, 0.0, _MOST_LEVERAGE)


def _kind(effect: Effect, field: str) -> tuple[str, bool]:
    """Parameters of one kind share a level: those of one effect, lengths and angles apart."""
    return effect.effect, getattr(effect, "field", field) in ("alpha", "beta")


def _spread(design: Array, values: Array, weighing: Weighing, kinds: Sequence[tuple[str, bool]]) -> Array:
    """Levels (p,) at which what is found is likeliest: the mean square of what the data tell is that of the prior.

    From the lowest upwards, since there may be several: a parameter that is hardly told can always have been large.
    """
    H = _information(design, len(values))
    pull = H @ values + values / weighing.spread**2
    spread = np.full(len(values), LEVELS[0])
    for _ in range(_TURNS):
        covariance = np.linalg.inv(H + np.diag(1 / spread**2))
        mean = covariance @ pull
        told = 1 - np.diag(covariance) / spread**2
        before, spread = spread, spread.copy()
        for kind in set(kinds):
            own = [k for k, other in enumerate(kinds) if other == kind]
            level = float(np.sqrt((mean[own] ** 2).sum() / max(float(told[own].sum()), 1e-9)))
            spread[own] = min(max(level, LEVELS[0]), LEVELS[1])
        settled = np.abs(np.log(spread / before)).max() < _SETTLED
        if settled:
            break
    return spread
