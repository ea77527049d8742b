"""Sizes and shapes of named effects on the simulator, by Gauss-Newton, all others there as a healthy arm has them.

A right name in a wrong form would draw other names to mend it: so each effect's shape (how gradual a play is crossed, a
third harmonic, the order of a gear, a decay) is fitted with its size, held by what is plausible. The set-ups are fitted
with them, and exactly: a large effect moves the ball that a fit without it had found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.diagnose.evidence import WIDE, Background
from analysis.diagnose.forms import form_columns
from analysis.diagnose.linear import Linear, basis_of
from analysis.kinematics.arm import Array
from analysis.model.predict import SetUp
from rigs.effect import PHASE, is_wave
from rigs.effects import Effect, bounds, healthy_size, size_field

_ROUNDS = 10
_FURTHEST = 4.0
_SETTLING = 6
_LARGE = 4.0
"""Chi-square a reading from which on effects are large enough to turn what set-ups can do."""
_TURNS = 2
_STEP_MM = 2.0
"""No step of a set-up goes further, for a ball's height knows no bound."""
_SETTLED_MM = 5e-4
_ENOUGH = 0.02
"""Half a chi-square that a round must gain to go on."""
_STANDS_MM = 1.0
"""How far a ball or an instrument may be from where the first fit has it: decides only what the readings hardly tell,
such as a ball's height."""


@dataclass(frozen=True)
class Unknown:
    """One number to be found: which effect, which field; expected value and prior spread."""

    effect: int
    field: str
    expected: float
    spread: float


@dataclass(frozen=True)
class Refined:
    """Effects with fitted sizes and shapes.

    unknowns, their values (q,) and covariance (q, q), and which of them (q,) are free: not at a bound of what they may
    be; left (N,): what stays of the residual, in standard deviations; tangents (N, q): what a little more of each
    unknown would add; setups; evidence: log of it by Laplace, over nothing named, no prices paid.
    """

    effects: tuple[Effect, ...]
    unknowns: tuple[Unknown, ...]
    values: Array
    covariance: Array
    free: NDArray[np.bool_]
    left: Array
    tangents: Array
    setups: dict[str, SetUp]
    evidence: float

    def sd(self, effect: int) -> dict[str, float]:
        """Standard uncertainty of each fitted parameter of one effect."""
        sds = np.sqrt(np.diag(self.covariance))
        return {u.field: float(sd) for u, sd in zip(self.unknowns, sds, strict=True) if u.effect == effect}


def refine(linear: Linear, background: Background, effects: Sequence[Effect]) -> Refined:
    """Fit sizes and shapes of effects, from where they are. None leaves the residual as it is."""
    return _Problem(linear, background, effects).solved(effects)


class _Problem:
    def __init__(self, linear: Linear, background: Background, effects: Sequence[Effect]) -> None:
        forms = form_columns(linear, effects)
        self.linear, self.background = linear, background.beside(forms)
        self._plain, self._forms = background, forms
        self.unknowns = _unknowns(linear, effects)
        self.expected = np.array([u.expected for u in self.unknowns])
        self.spread = np.array([u.spread for u in self.unknowns])
        self._held = np.where(linear.stands, 1 / _STANDS_MM**2, 1e-9)
        self._about(linear.U)

    def _about(self, U: Array) -> None:
        """Take what set-ups can do to be U (N, s)."""
        self._U, self._normal, self._basis = U, U.T @ U, basis_of(U)

    def _projected(self, columns: Array) -> Array:
        return columns - self._basis @ (self._basis.T @ columns)

    def solved(self, effects: Sequence[Effect]) -> Refined:
        """Fitted from where effects are; large ones turn what set-ups can do, so that is found anew on the way."""
        now: list[Any] = list(effects)
        _, plain = self._settled([], np.zeros(len(self._held)))
        whole = self._plain.chi2(plain)
        large = bool(now) and float(np.mean(plain**2)) > _LARGE
        moved = np.zeros(len(self._held))
        for _ in range(_TURNS if large else 0):
            moved, _ = self._settled(now, moved)
            self._about(self.linear.setup_columns(now, self.linear.placed(moved)))
        return self._solved(now, whole, moved)

    def _solved(self, now: list[Any], whole: float, moved: Array) -> Refined:
        x = np.array([float(getattr(now[u.effect], u.field)) for u in self.unknowns])
        moved, r = self._settled(now, moved)
        cost, damping = self._cost(r, x), 1e-4
        for _ in range(_ROUNDS):
            J = self._slopes(now)
            H = self.background.product(J, J) + np.diag(1 / self.spread**2)
            gradient = self.background.product(J, r[:, None])[:, 0] - (x - self.expected) / self.spread**2
            for _ in range(5):
                step = np.linalg.solve(H + damping * np.diag(np.diag(H)), gradient)
                tried = self._bounded(now, x + step)
                there = self._with(now, tried)
                there_moved, there_r = self._settled(there, moved)
                there_cost = self._cost(there_r, tried)
                if there_cost < cost:
                    break
                damping = max(damping, 1e-2) * 8
            else:
                break
            gained = cost - there_cost
            x, now, moved, r, cost, damping = tried, there, there_moved, there_r, there_cost, damping / 10
            if gained < _ENOUGH:
                break
        J = self._slopes(now)
        H = self.background.product(J, J) + np.diag(1 / self.spread**2)
        occam = np.linalg.slogdet(H)[1] + 2 * np.log(self.spread).sum() + self.background.logdet - self._plain.logdet
        covariance: Array = np.asarray(np.linalg.inv(H), dtype=float)
        evidence = 0.5 * (whole - cost) - 0.5 * float(occam)
        r = r - self._forms @ (self._forms.T @ self.background.weighted(r))
        limits = np.array([self._limits(now, unknown) for unknown in self.unknowns]).reshape(-1, 2)
        free = (x > limits[:, 0]) & (x < limits[:, 1])
        return Refined(tuple(now), tuple(self.unknowns), x, covariance, free, r, J, self.linear.placed(moved), evidence)

    def _settled(self, effects: Sequence[Effect], moved: Array) -> tuple[Array, Array]:
        """Set-ups fitted to what effects leave, as how far (s,) mm they moved, and what is left without what they could
        still do."""
        left = self.linear.leaving(effects)
        for _ in range(_SETTLING):
            r = left(self.linear.placed(moved))
            held = self._held * max(1.0, float(np.mean(r**2)))
            change = np.linalg.solve(self._normal + np.diag(held), self._U.T @ r - held * moved)
            if np.abs(change).max() < _SETTLED_MM:
                break
            moved = moved + change * min(1.0, _STEP_MM / np.abs(change).max())
        else:
            r = left(self.linear.placed(moved))
        return moved, self._projected(r)

    def _cost(self, r: Array, x: Array) -> float:
        chi2 = self.background.chi2(r)
        return chi2 + float((((x - self.expected) / self.spread) ** 2).sum())

    def _slopes(self, effects: Sequence[Any]) -> Array:
        """Derivatives (N, q) of what effects add, set-up terms projected out: one effect at a time, since they add."""
        steps = [_step(effects[unknown.effect], unknown) for unknown in self.unknowns]
        changed = [
            effects[u.effect].model_copy(update={u.field: float(getattr(effects[u.effect], u.field)) + step})
            for u, step in zip(self.unknowns, steps, strict=True)
        ]
        base = self.linear.raw(effects)[:, [u.effect for u in self.unknowns]]
        return self._projected((self.linear.raw(changed) - base) / steps)

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
            return low, high
        # A shape stays near what is plausible, wherever a first step would throw it.
        reach = _FURTHEST * unknown.spread
        return max(low, unknown.expected - reach), min(high, unknown.expected + reach)

    def _with(self, effects: Sequence[Any], x: Array) -> list[Any]:
        made = list(effects)
        for unknown, value in zip(self.unknowns, x, strict=True):
            made[unknown.effect] = made[unknown.effect].model_copy(update={unknown.field: float(value)})
        return made


def _unknowns(linear: Linear, effects: Sequence[Effect]) -> list[Unknown]:
    """What is to be found of some effects."""
    found = []
    sigma = np.linalg.norm(linear.columns(effects), axis=0)
    for k, effect in enumerate(effects):
        field = size_field(effect)
        size = abs(float(getattr(effect, field)))
        # As wide as the evidence has it: 35 sigma, or the effect's own size.
        spread = size * np.hypot(1.0, WIDE / max(float(sigma[k]), 1e-9))
        found.append(Unknown(k, field, 0.0, max(spread, 1e-12)))
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
