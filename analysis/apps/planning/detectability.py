"""Effects that planned tests can detect and distinguish, and useful further tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnosis.evidence.significance import CERTAIN_SIGMA
from analysis.diagnosis.fit.candidates import LARGEST_FAULT, Candidate
from analysis.diagnosis.fit.responses import Linearisation
from analysis.diagnosis.plan.expected import (
    SEPARABLE,
    ExpectedPosterior,
    is_detectable,
)
from analysis.procedures.shared.test_kind import labels_of
from analysis.robot.kinematics.arm import Array
from analysis.runs.noise.cell_noise import BALL_MM, JOINT_DEG, SLOW_MM, TARGET_MM, WHITE_MM
from rigs.effects import Effect, turned
from rigs.schema.effect import healthy, healthy_size, label_of, name_of, scaled
from rigs.schema.vocabulary import WITHOUT_GAUGES, TestName

# Planned tests: names, and assumed noise.

_ASSUMED_UM = {
    "gauges, white": 1e3 * WHITE_MM.rms,
    "along a lap, slow": 1e3 * SLOW_MM.rms,
    "the ball, from run to run": 1e3 * BALL_MM.rms,
    "a target, from stop to stop": 1e3 * TARGET_MM.rms,
}
"""Assumed noise of planned runs, rms in µm of a run, from the ranges of `analysis.runs.noise.cell_noise`."""
ASSUMED_JOINT_DEG = JOINT_DEG.rms
"""Assumed scatter of each joint between planned runs, from the range of real cells."""


def assumed_noise_um(tests: Sequence[TestName]) -> dict[str, float]:
    if set(tests) <= set(WITHOUT_GAUGES):
        return {"a touch, each coordinate": 1e3 * TARGET_MM.rms}
    return _ASSUMED_UM


@dataclass(frozen=True)
class SeparatingTest:
    test: str
    sigma: float
    """Separation of the two closest rivals with this and the existing tests."""
    why: str


# Detectability of one name in planned runs: expected uncertainty of its size, or the reason against detection.

_ON_AXIS = 0.02
"""Share of the largest response of a joint's zero below which the axis passes through the ball. Chosen."""
_NUDGE_DEG = 0.02
"""Joint rotation for comparing responses; only ratios matter."""
_OWN_SHARE = 0.02
"""Share of a response below which the set-up absorbs it: the error of the linear approximation."""
_NOTHING = 1e-3
"""Sigmas below which a response counts as zero, above rounding errors."""


@dataclass(frozen=True)
class Detectability:
    name: str
    effect: Effect
    """The effect at a healthy size."""
    sd: float
    """Standard uncertainty of a fault's size, in the unit of the effect."""
    hidden: str
    """Reason against detection, or empty."""
    further: tuple[SeparatingTest, ...] = ()
    """Further tests by the sigmas of a healthy size."""

    @property
    def limit(self) -> float:
        """Size detected at 7 sigma, in the unit of the effect."""
        return CERTAIN_SIGMA * self.sd


def detectabilities_of(expected: ExpectedPosterior) -> tuple[list[Candidate], list[Detectability]]:
    """Candidate of each effect (for a gear by order, in the median form), and its detectability."""
    forms: dict[str, list[Candidate]] = {}
    for candidate in expected.candidates:
        forms.setdefault(label_of(candidate.effect), []).append(candidate)
    nudges = [turned(axis, _NUDGE_DEG) for axis in range(1, expected.linear.axes + 1)]
    zeros: Array = np.linalg.norm(expected.linear.columns(nudges), axis=0)
    chosen, detectabilities = [], []
    for label, candidates in forms.items():
        candidate = sorted(candidates, key=lambda form: form.size)[len(candidates) // 2]
        effect, sd = healthy(candidate.effect), expected.sd(candidate)
        hidden = "" if is_detectable(sd) else _why_hidden(effect, expected.linear, zeros)
        chosen.append(candidate)
        detectabilities.append(Detectability(label, effect, sd * healthy_size(effect), hidden))
    return chosen, detectabilities


def _why_hidden(effect: Effect, linear: Linearisation, zeros: Array) -> str:
    """Why tests cannot detect an effect. zeros (axes,): sigmas of each joint's zero, for a known set-up."""
    column, axis = linear.columns([effect])[:, 0], getattr(effect, "axis", None)
    whole, remaining = float(np.linalg.norm(column)), float(np.linalg.norm(linear.without_set_up(column)))
    if whole > _NOTHING and remaining < _OWN_SHARE * whole:
        terms = sorted({labels_of(block.table.test).setup for block in linear.blocks})
        return f"absorbed by the set-up: {'; '.join(terms)}, which are always fitted"
    if axis is not None and zeros[axis - 1] < _ON_AXIS * zeros.max():
        return f"the ball lies on axis {axis}"
    if LARGEST_FAULT * whole < _NOTHING:
        return effect.idle
    if LARGEST_FAULT * remaining < CERTAIN_SIGMA:
        return f"too small: below {CERTAIN_SIGMA:g} sigma even at {LARGEST_FAULT:g} times the usual size"
    return "hidden by the other effects of a healthy arm"


# Judgement of planned runs: detection limit of each name, and names that look alike.
#
# Two names look alike if one of them, at a detectable fault size, is so close to the other at some size that the odds
# dismiss neither.


@dataclass(frozen=True)
class ClosePair:
    """Closest forms of two effects at a detectable fault size."""

    candidates: tuple[Candidate, Candidate]
    sizes: tuple[float, float]
    """In healthy sizes."""
    sigma: float
    """Separation of the two."""
    others: int = 0
    """Number of other close forms of these effects."""
    further: tuple[SeparatingTest, ...] = ()

    @property
    def names(self) -> tuple[str, str]:
        first, second = self.candidates
        return first.name, second.name

    @property
    def effects(self) -> tuple[tuple[Effect, ...], tuple[Effect, ...]]:
        first, second = (
            tuple(scaled(healthy(effect), size) for effect in candidate.effects)
            for candidate, size in zip(self.candidates, self.sizes, strict=True)
        )
        return first, second

    @property
    def labels(self) -> tuple[str, str]:
        """The two effects, for a gear error with its order."""
        (first, *_), (second, *_) = self.effects
        return label_of(first), label_of(second)


@dataclass(frozen=True)
class Judgement:
    detectabilities: tuple[Detectability, ...]
    pairs: tuple[ClosePair, ...]
    """Pairs that look alike, closest first."""

    @property
    def names(self) -> dict[str, tuple[Detectability, ...]]:
        """Each effect with its detectabilities, for gears one per order."""
        named: dict[str, tuple[Detectability, ...]] = {}
        for detectability in self.detectabilities:
            name = name_of(detectability.effect)
            named[name] = (*named.get(name, ()), detectability)
        return named

    @property
    def undetectable(self) -> tuple[str, ...]:
        return tuple(name for name, forms in self.names.items() if all(form.hidden for form in forms))

    @property
    def groups(self) -> list[list[str]]:
        groups: list[list[str]] = []
        for names in [pair.names for pair in self.pairs]:
            joined = [group for group in groups if set(group) & set(names)]
            groups = [group for group in groups if group not in joined]
            groups.append(list(dict.fromkeys([name for group in joined for name in group] + list(names))))
        return groups


def judge_posterior(expected: ExpectedPosterior) -> Judgement:
    chosen, detectabilities = detectabilities_of(expected)
    pairs = zip(chosen, detectabilities, strict=True)
    seen = [(candidate, one) for candidate, one in pairs if not one.hidden]
    sizes = [max(expected.least(one.effect), one.limit / healthy_size(one.effect)) for _, one in seen]
    closest: dict[tuple[str, str], ClosePair] = {}
    for i, j in expected.close_pairs([candidate for candidate, _ in seen], np.array(sizes)):
        bare = ClosePair((seen[i][0], seen[j][0]), (sizes[i], sizes[j]), 0.0)
        pair = replace(bare, sigma=separation_sigma(expected, bare))
        if pair.sigma < SEPARABLE:
            earlier = closest.get(pair.names)
            nearer = pair if earlier is None or pair.sigma < earlier.sigma else earlier
            closest[pair.names] = replace(nearer, others=earlier.others + 1 if earlier else 0)
    return Judgement(tuple(detectabilities), tuple(sorted(closest.values(), key=lambda pair: pair.sigma)))


def separation_sigma(expected: ExpectedPosterior, pair: ClosePair) -> float:
    """Separation in sigmas of the two names of a pair, whichever is present."""
    first, second = pair.effects
    return min(expected.separation_sigma(first, second), expected.separation_sigma(second, first))
