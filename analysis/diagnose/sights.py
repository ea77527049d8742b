"""How one name shows in tests not yet driven: the size from which on it does, or why it does not at any."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.diagnose.candidates import Candidate
from analysis.diagnose.parting import Parting
from analysis.diagnose.signatures import DETECTABLE, LARGEST, NOTHING, View, shows
from analysis.kinematics.arm import Array
from rigs.effect import healthy, label_of, name_of
from rigs.effects import Effect, healthy_size, turned

_ON_AXIS = 0.02
"""An axis that moves the readings by less than this share of what the strongest does goes through the ball."""
_NUDGE_DEG = 0.02
"""By which joints are turned to see what moves the readings; what counts is one joint against another."""


@dataclass(frozen=True)
class Sight:
    """How one name shows. effect: at a healthy size; sigma: of that; limit: the size that shows at 7 sigma, in the
    effect's own unit; hidden: why it is not seen, empty where it is; further: tests by the sigma of a healthy size."""

    name: str
    effect: Effect
    sigma: float
    limit: float
    hidden: str
    further: tuple[Parting, ...] = ()


def sights_of(candidates: Sequence[Candidate], sigma: Array, view: View) -> list[Sight]:
    """How each name shows, a gear by its orders, in the middle one of its variants; sigma (n,): of a healthy size."""
    labels = [label_of(one.effect) for one in candidates]
    zeros = view.columns([turned(axis, _NUDGE_DEG) for axis in range(1, 7)])[1]
    sights = []
    for label in dict.fromkeys(labels):
        variants = sorted((k for k, other in enumerate(labels) if other == label), key=lambda k: sigma[k])
        k = variants[len(variants) // 2]
        effect = healthy(candidates[k].effect)
        limit = healthy_size(effect) * DETECTABLE / sigma[k] if sigma[k] > 0 else np.inf
        hidden = "" if shows(sigma[k]) else _reason(effect, sigma[k] > 0, float(view.columns([effect])[1][0]), zeros)
        sights.append(Sight(label, effect, float(sigma[k]), float(limit), hidden))
    return sights


def _reason(effect: Effect, own: bool, whole: float, zeros: Array) -> str:
    """Why an effect is not seen. own: whether some of it no set-up could do; whole: its sigmas were the set-up known;
    zeros (6,): those of each joint's zero."""
    axis = getattr(effect, "axis", None)
    through_ball = axis is not None and zeros[axis - 1] < _ON_AXIS * zeros.max()
    if whole > NOTHING and not own:
        return "the set-up takes it up: the ball's place and the gauges' zeros, which are always fitted"
    if through_ball:
        return f"the ball lies on axis {axis}"
    if LARGEST * whole < NOTHING:
        return effect.idle
    return f"too small: even {LARGEST:g} times a healthy arm's stays below {DETECTABLE:g} sigma"


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
