"""Sizes and shapes of named effects on the simulator, by Gauss-Newton, all else there as the background has it.

A right name in a wrong form would draw other names to mend it: so each effect's shape (how gradual a play is crossed, a
third harmonic, the order of a gear, a decay) is fitted with its size, held by what is plausible; and what stands beside
an effect because no gear, ball or brake is ideal (`forms`) is allowed for in proportion to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from analysis.diagnosis.background import Background, Known, Weighed
from analysis.diagnosis.columns import LARGEST
from analysis.diagnosis.forms import form_columns
from analysis.diagnosis.linear import Linear
from analysis.kinematics.arm import Array
from rigs.effects import Effect, bounds, healthy_size, size_field
from rigs.schema.effect import PHASE, is_wave

_ROUNDS = 8
_TRIES = 5
_FURTHEST = 4.0
_MOST = 120.0
"""Healthy sizes that no fault exceeds: beyond, a model is used where nothing of it was tried."""
_ENOUGH = 0.02
"""Half a chi-square that a round must gain to go on."""


_One = TypeVar("_One")


@dataclass(frozen=True)
class Unknown:
    """One number to be found: which effect, which field; expected value and prior spread; how low it may be."""

    effect: int
    field: str
    expected: float
    spread: float
    low: float = -np.inf


@dataclass(frozen=True)
class Refined:
    """Effects with fitted sizes and shapes. unknowns, their values (q,) and covariance (q, q); left (N,): what they
    leave of the readings, in standard deviations, set-ups and all else as they were; tangents (N, q): what a little
    more of each unknown would add; beside, of each effect (N, f): what may stand beside it, one standard deviation
    each; free (N, f): what has no name, likewise."""

    effects: tuple[Effect, ...]
    unknowns: tuple[Unknown, ...]
    values: Array
    covariance: Array
    left: Array
    tangents: Array
    beside: tuple[Array, ...]
    free: Array

    def sd(self, effect: int) -> dict[str, float]:
        """Standard uncertainty of each fitted parameter of one effect."""
        sds = np.sqrt(np.diag(self.covariance))
        return {u.field: float(sd) for u, sd in zip(self.unknowns, sds, strict=True) if u.effect == effect}

    @property
    def known(self) -> Known:
        """What is known beside the background, about these values."""
        T = np.concatenate([self.tangents, *self.beside, self.free], axis=1)
        allowed = T.shape[1] - len(self.values)
        precision = [unknown.spread**-2 for unknown in self.unknowns] + [1.0] * allowed
        away = np.array([unknown.expected for unknown in self.unknowns]) - self.values
        return Known(self.left, T, np.diag(precision), np.concatenate([away, np.zeros(allowed)]))

    def without(self, place: int) -> Refined:
        """The same without one effect, the others as they were; what is then left is still to be found."""
        kept = [k for k, unknown in enumerate(self.unknowns) if unknown.effect != place]
        unknowns = [replace(self.unknowns[k], effect=_before(self.unknowns[k].effect, place)) for k in kept]
        return replace(
            self, effects=_all_but(self.effects, place), unknowns=tuple(unknowns), values=self.values[kept],
            covariance=self.covariance[np.ix_(kept, kept)], tangents=self.tangents[:, kept],
            beside=_all_but(self.beside, place),
        )  # fmt: skip


def refine(
    linear: Linear,
    background: Background,
    effects: Sequence[Effect],
    fitted: Refined | None = None,
    free: Array | None = None,
) -> Refined:
    """Fit sizes and shapes of effects, from where they are. None leaves the residual as it is.

    fitted: an earlier fit of the first of these effects. They move with the others along the tangents that they had
    there, which costs a fraction and is off by how far they move; fit all once more where no more effects follow.
    free: columns (N, f), one standard deviation each, of what has no name and may take its part.
    """
    before = fitted or nothing(linear)
    return _Problem(linear, background, effects, before, before.free if free is None else free).solved(effects)


def nothing(linear: Linear) -> Refined:
    """A fit of no effects."""
    none = np.empty((len(linear.y), 0))
    return Refined((), (), np.empty(0), np.empty((0, 0)), linear.y, none, (), none)


@dataclass(frozen=True)
class _Against:
    """Values in the background, and across (f, k): with what may stand beside the effects."""

    weighed: Weighed
    across: Array


class _Problem:
    def __init__(
        self, linear: Linear, background: Background, effects: Sequence[Effect], fitted: Refined, free: Array
    ) -> None:
        self.linear, self.background, self.free = linear, background, free
        self.old = len(fitted.effects)
        self.unknowns = [*fitted.unknowns, *_unknowns(effects, self.old)]
        self.tangents = fitted.tangents
        self.beside = (*fitted.beside, *(form_columns(linear, one) for one in effects[self.old :]))
        self.expected = np.array([u.expected for u in self.unknowns])
        self.spread = np.array([u.spread for u in self.unknowns])
        beside = np.concatenate([*self.beside, free], axis=1)
        self._weighted_beside = background.solved(background.weighed(beside))
        own = beside.T @ self._weighted_beside
        own[np.diag_indices_from(own)] += 1.0
        self._inverse = np.linalg.inv(own)
        self._before = self._against(self.tangents)

    def solved(self, effects: Sequence[Effect]) -> Refined:
        """Levenberg's damping, within the bounds of what the parameters may be."""
        now: list[Any] = list(effects)
        x = np.array([float(getattr(now[u.effect], u.field)) for u in self.unknowns])
        r = self._against(self.linear.left(now)[:, None])
        cost, damping = self._cost(r, x), 1e-4
        J = self._slopes(now)
        H, fall = self._normal(J, r)
        for _ in range(_ROUNDS if len(x) else 0):
            gradient = fall - (x - self.expected) / self.spread**2
            for _ in range(_TRIES):
                step = np.linalg.solve(H + damping * np.diag(np.diag(H)), gradient)
                tried = self._bounded(now, x + step)
                there = self._with(now, tried)
                there_r = self._against(self.linear.left(there)[:, None])
                there_cost = self._cost(there_r, tried)
                if there_cost < cost:
                    break
                damping = max(damping, 1e-2) * 8
            else:
                break
            gained = cost - there_cost
            x, now, r, cost, damping = tried, there, there_r, there_cost, damping / 10
            J = self._slopes(now)
            H, fall = self._normal(J, r)
            if gained < _ENOUGH:
                break
        tangents = np.concatenate([self.tangents, J.weighed.values], axis=1)
        covariance: Array = np.asarray(np.linalg.inv(H), dtype=float)
        return Refined(
            tuple(now), tuple(self.unknowns), x, covariance, r.weighed.values[:, 0], tangents, self.beside, self.free
        )  # fmt: skip

    def _against(self, values: Array) -> _Against:
        """Values (N, k) against the background and what may stand beside the effects."""
        return _Against(self.background.weighed(values), self._weighted_beside.T @ values)

    def _product(self, one: _Against, other: _Against) -> Array:
        """one' (C + FF')⁻¹ other, F what may stand beside the effects: (k, l) for values (N, k) and (N, l)."""
        return one.weighed.products(other.weighed) - one.across.T @ self._inverse @ other.across

    def _normal(self, J: _Against, r: _Against) -> tuple[Array, Array]:
        """Of Gauss-Newton, for what is fitted before and slopes J of what is new: the normal matrix (q, q) and how fast
        the residual's cost falls with each unknown (q,)."""
        cross = self._product(self._before, J)
        H = np.block([[self._product(self._before, self._before), cross], [cross.T, self._product(J, J)]])
        fall = np.concatenate([self._product(self._before, r), self._product(J, r)])[:, 0]
        return H + np.diag(1 / self.spread**2), fall

    def _cost(self, r: _Against, x: Array) -> float:
        return float(self._product(r, r)[0, 0]) + float((((x - self.expected) / self.spread) ** 2).sum())

    def _slopes(self, effects: Sequence[Any]) -> _Against:
        """Derivatives (N, q) of what the effects that are new add: one effect at a time, since they add."""
        unknowns = self.unknowns[self.tangents.shape[1] :]
        steps = np.array([_step(effects[unknown.effect], unknown) for unknown in unknowns])
        changed = [
            effects[u.effect].model_copy(update={u.field: float(getattr(effects[u.effect], u.field)) + step})
            for u, step in zip(unknowns, steps, strict=True)
        ]
        base = self.linear.columns(effects[self.old :])[:, [u.effect - self.old for u in unknowns]]
        return self._against((self.linear.columns(changed) - base) / steps)

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
        return max(low, unknown.low, unknown.expected - reach), min(high, unknown.expected + reach)

    def _with(self, effects: Sequence[Any], x: Array) -> list[Any]:
        made = list(effects)
        for unknown, value in zip(self.unknowns, x, strict=True):
            made[unknown.effect] = made[unknown.effect].model_copy(update={unknown.field: float(value)})
        return made


def _unknowns(effects: Sequence[Effect], first: int) -> list[Unknown]:
    """What is to be found of effects from the first to be fitted on."""
    found = []
    for k, effect in enumerate(effects[first:], start=first):
        found.append(Unknown(k, size_field(effect), 0.0, LARGEST * healthy_size(effect)))
        if is_wave(effect):
            found.append(Unknown(k, PHASE, float(getattr(effect, PHASE)), 360.0))
        for stretched in effect.STRETCHED:
            begin = float(getattr(effect, stretched.field))
            found.append(
                Unknown(k, stretched.field, begin, max(stretched.share * begin, stretched.least), stretched.low)
            )
        found += [Unknown(k, free.field, free.expected, free.spread) for free in effect.FREE]
    return found


def _step(effect: Any, unknown: Unknown) -> float:
    """A small change into the inside of the bounds."""
    size = 1e-3 * unknown.spread if unknown.field != size_field(effect) else 0.05 * healthy_size(effect)
    _, high = bounds(effect, unknown.field)
    return -size if getattr(effect, unknown.field) + size > high else size


def _all_but(items: tuple[_One, ...], place: int) -> tuple[_One, ...]:
    return (*items[:place], *items[place + 1 :])


def _before(number: int, place: int) -> int:
    """A number, once the one at a place is gone."""
    return number - (number > place)
