"""Sizes and shapes of named effects on the simulator, by Gauss-Newton, all else there as the background has it.

A right name in a wrong form would draw other names to mend it: so each effect's shape (how gradual a play is crossed, a
third harmonic, the order of a gear, a decay) is fitted with its size, held by what is plausible; and what stands beside
an effect because no gear, ball or brake is ideal (`forms`) is allowed for in proportion to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.diagnose.background import Background, Known
from analysis.diagnose.columns import LARGEST
from analysis.diagnose.forms import form_columns
from analysis.diagnose.linear import Linear
from analysis.kinematics.arm import Array
from rigs.effect import PHASE, is_wave
from rigs.effects import Effect, bounds, healthy_size, size_field

_ROUNDS = 8
_TRIES = 5
_FURTHEST = 4.0
_MOST = 120.0
"""Healthy sizes that no fault exceeds: beyond, a model is used where nothing of it was tried."""
_ENOUGH = 0.02
"""Half a chi-square that a round must gain to go on."""


@dataclass(frozen=True)
class Unknown:
    """One number to be found: which effect, which field; expected value and prior spread."""

    effect: int
    field: str
    expected: float
    spread: float


@dataclass(frozen=True)
class Refined:
    """Effects with fitted sizes and shapes. unknowns, their values (q,) and covariance (q, q); left (N,): what they
    leave of the readings, in standard deviations, set-ups and all else as they were; tangents (N, q): what a little
    more of each unknown would add; departures (N, f): what may stand beside them, one standard deviation each."""

    effects: tuple[Effect, ...]
    unknowns: tuple[Unknown, ...]
    values: Array
    covariance: Array
    left: Array
    tangents: Array
    departures: Array

    def sd(self, effect: int) -> dict[str, float]:
        """Standard uncertainty of each fitted parameter of one effect."""
        sds = np.sqrt(np.diag(self.covariance))
        return {u.field: float(sd) for u, sd in zip(self.unknowns, sds, strict=True) if u.effect == effect}

    @property
    def known(self) -> Known:
        """What is known beside the background, about these values."""
        precision = [unknown.spread**-2 for unknown in self.unknowns] + [1.0] * self.departures.shape[1]
        away = np.array([unknown.expected for unknown in self.unknowns]) - self.values
        T = np.concatenate([self.tangents, self.departures], axis=1)
        return Known(self.left, T, np.diag(precision), np.concatenate([away, np.zeros(self.departures.shape[1])]))


def refine(linear: Linear, background: Background, effects: Sequence[Effect]) -> Refined:
    """Fit sizes and shapes of effects, from where they are. None leaves the residual as it is."""
    return _Problem(linear, background, effects).solved(effects)


class _Problem:
    def __init__(self, linear: Linear, background: Background, effects: Sequence[Effect]) -> None:
        self.linear, self.background = linear, background
        self.forms = form_columns(linear, effects)
        self.unknowns = _unknowns(effects)
        self.expected = np.array([u.expected for u in self.unknowns])
        self.spread = np.array([u.spread for u in self.unknowns])
        self._weighted_forms = background.solved(self.forms)
        own = self.forms.T @ self._weighted_forms
        own[np.diag_indices_from(own)] += 1.0
        self._inverse = np.linalg.inv(own)

    def _solved(self, values: Array) -> Array:
        """(C + FF')⁻¹ values, F what may stand beside the effects."""
        found: Array = self.background.solved(values)
        return found - self._weighted_forms @ (self._inverse @ (self._weighted_forms.T @ values))

    def solved(self, effects: Sequence[Effect]) -> Refined:
        """Levenberg's damping, within the bounds of what the parameters may be."""
        now: list[Any] = list(effects)
        x = np.array([float(getattr(now[u.effect], u.field)) for u in self.unknowns])
        r = self.linear.left(now)
        cost, damping = self._cost(r, x), 1e-4
        for _ in range(_ROUNDS if now else 0):
            J = self._slopes(now)
            weighted = self._solved(J)
            H = J.T @ weighted + np.diag(1 / self.spread**2)
            gradient = weighted.T @ r - (x - self.expected) / self.spread**2
            for _ in range(_TRIES):
                step = np.linalg.solve(H + damping * np.diag(np.diag(H)), gradient)
                tried = self._bounded(now, x + step)
                there = self._with(now, tried)
                there_r = self.linear.left(there)
                there_cost = self._cost(there_r, tried)
                if there_cost < cost:
                    break
                damping = max(damping, 1e-2) * 8
            else:
                break
            gained = cost - there_cost
            x, now, r, cost, damping = tried, there, there_r, there_cost, damping / 10
            if gained < _ENOUGH:
                break
        J = self._slopes(now)
        H = J.T @ self._solved(J) + np.diag(1 / self.spread**2)
        covariance: Array = np.asarray(np.linalg.inv(H), dtype=float)
        return Refined(tuple(now), tuple(self.unknowns), x, covariance, r, J, self.forms)

    def _cost(self, r: Array, x: Array) -> float:
        return float(r @ self._solved(r)) + float((((x - self.expected) / self.spread) ** 2).sum())

    def _slopes(self, effects: Sequence[Any]) -> Array:
        """Derivatives (N, q) of what effects add: one effect at a time, since they add."""
        steps = np.array([_step(effects[unknown.effect], unknown) for unknown in self.unknowns])
        changed = [
            effects[u.effect].model_copy(update={u.field: float(getattr(effects[u.effect], u.field)) + step})
            for u, step in zip(self.unknowns, steps, strict=True)
        ]
        base = self.linear.columns(effects)[:, [u.effect for u in self.unknowns]]
        slopes: Array = (self.linear.columns(changed) - base) / steps
        return slopes

    def _bounded(self, effects: Sequence[Any], x: Array) -> Array:
        held = x.copy()
        for k, unknown in enumerate(self.unknowns):
            if unknown.field == PHASE:
                held[k] = (held[k] + 180) % 360 - 180
            else:
                held[k] = np.clip(held[k], *self._limits(effects, unknown))
        return held

    def _limits(self, effects: Sequence[Any], unknown: Unknown) -> tuple[float, float]:
        """What an unknown may be; a phase anything."""
        if unknown.field == PHASE:
            return -np.inf, np.inf
        low, high = bounds(effects[unknown.effect], unknown.field)
        if unknown.field == size_field(effects[unknown.effect]):
            most = _MOST * healthy_size(effects[unknown.effect])
            return max(low, -most), min(high, most)
        # A shape stays near what is plausible, wherever a first step would throw it.
        reach = _FURTHEST * unknown.spread
        return max(low, unknown.expected - reach), min(high, unknown.expected + reach)

    def _with(self, effects: Sequence[Any], x: Array) -> list[Any]:
        made = list(effects)
        for unknown, value in zip(self.unknowns, x, strict=True):
            made[unknown.effect] = made[unknown.effect].model_copy(update={unknown.field: float(value)})
        return made


def _unknowns(effects: Sequence[Effect]) -> list[Unknown]:
    """What is to be found of some effects."""
    found = []
    for k, effect in enumerate(effects):
        found.append(Unknown(k, size_field(effect), 0.0, LARGEST * healthy_size(effect)))
        if is_wave(effect):
            found.append(Unknown(k, PHASE, float(getattr(effect, PHASE)), 360.0))
        for stretched in effect.STRETCHED:
            begin = float(getattr(effect, stretched.field))
            found.append(Unknown(k, stretched.field, begin, max(stretched.share * begin, stretched.least)))
        found += [Unknown(k, free.field, free.expected, free.spread) for free in effect.FREE]
    return found


def _step(effect: Any, unknown: Unknown) -> float:
    """A small change into the inside of the bounds."""
    size = 1e-3 * unknown.spread if unknown.field != size_field(effect) else 0.05 * healthy_size(effect)
    _, high = bounds(effect, unknown.field)
    return -size if getattr(effect, unknown.field) + size > high else size
