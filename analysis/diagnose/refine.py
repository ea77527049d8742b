"""Sizes and shapes of named effects by Gauss-Newton, every other effect present at a healthy arm's size.

A right name in a wrong form would draw other names to mend it: so each effect's shape (how gradual a play is crossed, a
third harmonic, the order of a gear, a decay) is fitted with its size, held by what is plausible.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.diagnose.response import Response
from analysis.kinematics.arm import Array
from rigs.effects import Effect, TransmissionError, healthy_size, size_field

_WIDE = 70.0
"""Prior spread of a named size, in healthy sizes."""
_ROUNDS = 8
_SHAPES: dict[str, dict[str, tuple[float, float]]] = {
    "backlash": {"transit": (0.2, 0.4)},
    "transmission_error": {"third": (0.0, 0.3)},
    "compliance": {"payload_kg": (5.0, 5.0)},
    "reversal_spike": {"decay_s": (0.3, 0.3)},
    "thermal_growth": {"time_constant_s": (600.0, 400.0)},
}
"""Shapes that are fitted: what is expected, and how far it may be off."""


@dataclass(frozen=True)
class Unknown:
    """One number to be found: which effect, which field; expected value and prior spread."""

    effect: int
    field: str
    expected: float
    spread: float


@dataclass(frozen=True)
class Refined:
    """Effects with fitted sizes and shapes; unknowns, their values (q,) and covariance (q, q); left (N,): what stays of
    the residual; evidence: log of it by Laplace, over nothing named, no prices paid."""

    effects: tuple[Effect, ...]
    unknowns: tuple[Unknown, ...]
    values: Array
    covariance: Array
    left: Array
    evidence: float


class Background:
    """The covariance I + G H² G' of noise and a healthy arm's share of every effect, by Woodbury's identity."""

    def __init__(self, G: Array, healthy: Array) -> None:
        chol = np.linalg.cholesky(G.T @ G + np.diag(1 / healthy**2))
        self._half = np.linalg.solve(chol, G.T)

    def halved(self, columns: Array) -> Array:
        """What must be taken off X'X and X'y: (p, …)."""
        return self._half @ columns

    def weighted(self, columns: Array) -> Array:
        """C⁻¹ columns, (N, …)."""
        return columns - self._half.T @ self.halved(columns)

    def product(self, left: Array, right: Array) -> Array:
        """left' C⁻¹ right."""
        return left.T @ right - self.halved(left).T @ self.halved(right)


def unknowns_of(effects: Sequence[Effect]) -> list[Unknown]:
    """What is to be found of some effects."""
    found = []
    for k, effect in enumerate(effects):
        found.append(Unknown(k, size_field(effect), 0.0, _WIDE * healthy_size(effect)))
        if isinstance(effect, TransmissionError):
            found.append(Unknown(k, "phase_deg", effect.phase_deg, 360.0))
            found.append(Unknown(k, "order", effect.order, 0.05 * effect.order))
        for field, (expected, spread) in _SHAPES.get(effect.effect, {}).items():
            found.append(Unknown(k, field, expected, spread))
    return found


def refine(response: Response, background: Background, effects: Sequence[Effect]) -> Refined:
    """Fit sizes and shapes of effects, from where they are, to the residual of a response."""
    unknowns = unknowns_of(effects)
    now: list[Any] = list(effects)
    x = np.array([float(getattr(now[u.effect], u.field)) for u in unknowns])
    expected = np.array([u.expected for u in unknowns])
    spread = np.array([u.spread for u in unknowns])
    y, cost, damping = response.y, np.inf, 1e-3
    added = response.of(now).sum(axis=1)
    cost = _cost(background, y - added, x, expected, spread)
    for _ in range(_ROUNDS):
        J = _slopes(response, now, unknowns)
        H = background.product(J, J) + np.diag(1 / spread**2)
        gradient = background.product(J, (y - added)[:, None])[:, 0] - (x - expected) / spread**2
        for _ in range(6):
            step = np.linalg.solve(H + damping * np.diag(np.diag(H)), gradient)
            tried = _bounded(now, unknowns, x + step)
            there = _with(now, unknowns, tried)
            there_added = response.of(there).sum(axis=1)
            there_cost = _cost(background, y - there_added, tried, expected, spread)
            if there_cost < cost:
                break
            damping *= 8
        else:
            break
        gained = cost - there_cost
        x, now, added, cost, damping = tried, there, there_added, there_cost, max(damping / 10, 1e-6)
        if gained < 1e-2:
            break
    J = _slopes(response, now, unknowns)
    H = background.product(J, J) + np.diag(1 / spread**2)
    base = float(background.product(y[:, None], y[:, None])[0, 0])
    sign, logdet = np.linalg.slogdet(H)
    evidence = 0.5 * (base - cost) - 0.5 * (logdet + 2 * np.log(spread).sum()) if sign > 0 else -np.inf
    covariance: Array = np.asarray(np.linalg.inv(H), dtype=float)
    return Refined(tuple(now), tuple(unknowns), x, covariance, y - added, float(evidence))


def _cost(background: Background, left: Array, x: Array, expected: Array, spread: Array) -> float:
    return float(background.product(left[:, None], left[:, None])[0, 0] + (((x - expected) / spread) ** 2).sum())


def _slopes(response: Response, effects: Sequence[Any], unknowns: Sequence[Unknown]) -> Array:
    """Derivatives (N, q), one effect at a time since responses add."""
    own = response.of(effects)
    changed = []
    for unknown in unknowns:
        effect = effects[unknown.effect]
        step = _step(effect, unknown)
        value = float(getattr(effect, unknown.field))
        changed.append(effect.model_copy(update={unknown.field: value + step}))
    moved = response.of(changed)
    steps = np.array([_step(effects[u.effect], u) for u in unknowns])
    columns: Array = (moved - own[:, [u.effect for u in unknowns]]) / steps
    return columns


def _step(effect: Any, unknown: Unknown) -> float:
    """A small change into the inside of the bounds."""
    size = 1e-3 * unknown.spread if unknown.field != size_field(effect) else 0.05 * healthy_size(effect)
    _, high = bounds(effect, unknown.field)
    return -size if getattr(effect, unknown.field) + size > high else size


def bounds(effect: Any, field: str) -> tuple[float, float]:
    """Lowest and highest value of a parameter."""
    metadata = type(effect).model_fields[field].metadata
    low = max((float(getattr(m, name)) for m in metadata for name in ("ge", "gt") if hasattr(m, name)), default=-np.inf)
    high = min((float(m.le) for m in metadata if hasattr(m, "le")), default=np.inf)
    return low, high


def _bounded(effects: Sequence[Any], unknowns: Sequence[Unknown], x: Array) -> Array:
    held = x.copy()
    for k, unknown in enumerate(unknowns):
        low, high = bounds(effects[unknown.effect], unknown.field)
        held[k] = np.clip(held[k], low, high)
    return held


def _with(effects: Sequence[Any], unknowns: Sequence[Unknown], x: Array) -> list[Any]:
    made = list(effects)
    for unknown, value in zip(unknowns, x, strict=True):
        made[unknown.effect] = made[unknown.effect].model_copy(update={unknown.field: float(value)})
    return made
