"""How one name shows in runs that are not driven yet: how surely its size will be known, or why it is not seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.candidates import Candidate
from analysis.diagnosis.columns import LARGEST
from analysis.diagnosis.foresight import DETECTABLE, Foresight, shows
from analysis.diagnosis.linear import Linear
from analysis.diagnosis.parting import Parting
from analysis.kinematics.arm import Array
from rigs.effects import Effect, healthy_size, turned
from rigs.schema.effect import healthy, label_of, name_of

_ON_AXIS = 0.02
"""An axis that moves the readings by less than this share of what the strongest does goes through the ball."""
_NUDGE_DEG = 0.02
"""By which joints are turned to see what moves the readings; what counts is one joint against another."""
_OWN_SHARE = 0.02
"""Of an effect that no set-up could do; less is what the straight lines of a linearisation leave of curved ones."""
_NOTHING = 1e-3
"""Sigmas that are none."""


@dataclass(frozen=True)
class Sight:
    """How one name shows. effect: at a healthy size; sd: standard uncertainty of a fault's size, in the effect's own
    unit; hidden: why it is not seen, empty where it is; further: tests by the sigma of a healthy size."""

    name: str
    effect: Effect
    sd: float
    hidden: str
    further: tuple[Parting, ...] = ()

    @property
    def limit(self) -> float:
        """The size that shows at 7 sigma, in the effect's own unit."""
        return DETECTABLE * self.sd


def sights_of(foresight: Foresight) -> tuple[list[Candidate], list[Sight]]:
    """How each name shows, a gear by its orders, in the middle one of its forms; and the candidates that are these."""
    forms: dict[str, list[Candidate]] = {}
    for one in foresight.candidates:
        forms.setdefault(label_of(one.effect), []).append(one)
    zeros = _sigma(foresight.linear, [turned(axis, _NUDGE_DEG) for axis in range(1, 7)])
    chosen, sights = [], []
    for label, own in forms.items():
        one = sorted(own, key=lambda form: form.size)[len(own) // 2]
        effect, sd = healthy(one.effect), foresight.sd(one)
        hidden = "" if shows(sd) else _reason(foresight.linear, effect, zeros)
        chosen.append(one)
        sights.append(Sight(label, effect, sd * healthy_size(effect), hidden))
    return chosen, sights


def _reason(linear: Linear, effect: Effect, zeros: Array) -> str:
    """Why an effect is not seen; zeros (6,): sigmas of each joint's zero, were the set-up known."""
    column = linear.columns([effect])[:, 0]
    whole, own = float(np.linalg.norm(column)), float(np.linalg.norm(linear.set_up(column)))
    if whole > _NOTHING and own < _OWN_SHARE * whole:
        return "the set-up takes it up: the ball's place and the gauges' zeros, which are always fitted"
    axis = getattr(effect, "axis", None)
    if axis is not None and zeros[axis - 1] < _ON_AXIS * zeros.max():
        return f"the ball lies on axis {axis}"
    if LARGEST * whole < _NOTHING:
        return effect.idle
    if LARGEST * own < DETECTABLE:
        return f"too small: even {LARGEST:g} times a healthy arm's stays below {DETECTABLE:g} sigma"
    return "what a healthy arm shows of everything else hides it"


def _sigma(linear: Linear, effects: Sequence[Effect]) -> Array:
    sigma: Array = np.linalg.norm(linear.columns(effects), axis=0)
    return sigma


def by_name(sights: Sequence[Sight]) -> dict[str, tuple[Sight, ...]]:
    """Sights by the name of an effect: one each, or those of the orders of a gear."""
    found: dict[str, tuple[Sight, ...]] = {}
    for sight in sights:
        name = name_of(sight.effect)
        found[name] = (*found.get(name, ()), sight)
    return found


def unseen(sights: Sequence[Sight]) -> tuple[str, ...]:
    """Names of which nothing shows."""
    return tuple(name for name, forms in by_name(sights).items() if all(one.hidden for one in forms))
