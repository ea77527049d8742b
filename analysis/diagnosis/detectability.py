"""The detectability of one name in planned runs: the expected uncertainty of its size, or the reason why it cannot be
detected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.candidates import Candidate
from analysis.diagnosis.columns import LARGEST_FAULT
from analysis.diagnosis.expected_posterior import ExpectedPosterior
from analysis.diagnosis.form_posterior import DETECTABLE, is_detectable
from analysis.diagnosis.linearisation import Linearisation
from analysis.diagnosis.separating_tests import SeparatingTest
from analysis.kinematics.arm import Array
from rigs.effects import Effect, healthy_size, turned
from rigs.schema.effect import healthy, label_of, name_of

_ON_AXIS = 0.02
"""Share of the largest response of a joint's zero below which the axis is reported to pass through the ball. Chosen: a
ball within 2 % of the reach."""
_NUDGE_DEG = 0.02
"""Angle by which joints are turned to compare their responses; only the ratios matter."""
_OWN_SHARE = 0.02
"""Share of an effect's response that no set-up can absorb, below which the set-up is reported as the reason. Smaller
shares are within the linearisation error of curved responses."""
_NOTHING = 1e-3
"""Sigmas below which a response counts as zero: far below any detection, and above rounding errors."""


@dataclass(frozen=True)
class Detectability:
    """The detectability of one name. `effect` has a healthy size; `sd` is the standard uncertainty of a fault's size in
    the effect's own unit; `hidden` is the reason why it cannot be detected, or empty; `further` lists tests by the
    sigmas of a healthy size."""

    name: str
    effect: Effect
    sd: float
    hidden: str
    further: tuple[SeparatingTest, ...] = ()

    @property
    def limit(self) -> float:
        """The size that is detected at 7 sigma, in the effect's own unit."""
        return DETECTABLE * self.sd


def detectabilities_of(expected: ExpectedPosterior) -> tuple[list[Candidate], list[Detectability]]:
    """Return the candidates that represent each name, a gear by its orders and in the middle one of its forms, and
    their detectabilities."""
    forms: dict[str, list[Candidate]] = {}
    for one in expected.candidates:
        forms.setdefault(label_of(one.effect), []).append(one)
    zeros = _sigma(expected.linear, [turned(axis, _NUDGE_DEG) for axis in range(1, 7)])
    chosen, detectabilities = [], []
    for label, own in forms.items():
        one = sorted(own, key=lambda form: form.size)[len(own) // 2]
        effect, sd = healthy(one.effect), expected.sd(one)
        hidden = "" if is_detectable(sd) else _reason(expected.linear, effect, zeros)
        chosen.append(one)
        detectabilities.append(Detectability(label, effect, sd * healthy_size(effect), hidden))
    return chosen, detectabilities


def _reason(linear: Linearisation, effect: Effect, zeros: Array) -> str:
    """Return why an effect cannot be detected; `zeros` (6,) are the sigmas of each joint's zero, were the
    set-up known."""
    column = linear.columns([effect])[:, 0]
    whole, own = float(np.linalg.norm(column)), float(np.linalg.norm(linear.without_set_up(column)))
    if whole > _NOTHING and own < _OWN_SHARE * whole:
        return "the set-up absorbs it: the ball's position and the gauges' zeros, which are always fitted"
    axis = getattr(effect, "axis", None)
    if axis is not None and zeros[axis - 1] < _ON_AXIS * zeros.max():
        return f"the ball lies on axis {axis}"
    if LARGEST_FAULT * whole < _NOTHING:
        return effect.idle
    if LARGEST_FAULT * own < DETECTABLE:
        return f"too small: even {LARGEST_FAULT:g} times its healthy size stays below {DETECTABLE:g} sigma"
    return "the other effects of a healthy arm hide it"


def _sigma(linear: Linearisation, effects: Sequence[Effect]) -> Array:
    sigma: Array = np.linalg.norm(linear.columns(effects), axis=0)
    return sigma


def by_name(detectabilities: Sequence[Detectability]) -> dict[str, tuple[Detectability, ...]]:
    """Return detectabilities by the name of an effect: one each, or those of the orders of a gear."""
    found: dict[str, tuple[Detectability, ...]] = {}
    for one in detectabilities:
        name = name_of(one.effect)
        found[name] = (*found.get(name, ()), one)
    return found


def undetectable(detectabilities: Sequence[Detectability]) -> tuple[str, ...]:
    """Return the names of which nothing can be detected."""
    return tuple(name for name, forms in by_name(detectabilities).items() if all(one.hidden for one in forms))
