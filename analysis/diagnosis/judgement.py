"""The judgement of planned runs: from which size on each name is detected, and which names look alike.

Two names look alike if one of them, at a detectable fault size, is so close to the other at some size that the odds
between them dismiss neither.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnosis.candidates import Candidate
from analysis.diagnosis.detectability import Detectability, by_name, detectabilities_of, undetectable
from analysis.diagnosis.expected_posterior import ExpectedPosterior
from analysis.diagnosis.form_posterior import SEPARABLE
from rigs.effects import Effect
from rigs.schema.effect import healthy, healthy_size, scaled


@dataclass(frozen=True)
class ClosePair:
    """The closest forms of two names at a detectable fault size, given in healthy sizes, their separation in sigmas,
    and the number of other forms of these names that are close too."""

    candidates: tuple[Candidate, Candidate]
    sizes: tuple[float, float]
    sigma: float
    others: int = 0

    @property
    def names(self) -> tuple[str, str]:
        """The two names."""
        first, second = self.candidates
        return first.name, second.name

    @property
    def first(self) -> tuple[Effect, ...]:
        """The effects of the first name at its size."""
        return _at_size(self.candidates[0], self.sizes[0])

    @property
    def second(self) -> tuple[Effect, ...]:
        """The effects of the second name at its size."""
        return _at_size(self.candidates[1], self.sizes[1])


@dataclass(frozen=True)
class Judgement:
    """What runs can show: the detectability of each name, gears by order, and the pairs that look alike, the closest
    first."""

    detectabilities: tuple[Detectability, ...]
    pairs: tuple[ClosePair, ...]

    @property
    def names(self) -> dict[str, tuple[Detectability, ...]]:
        """Each name with its detectabilities: one, or one for each order of a gear."""
        return by_name(self.detectabilities)

    @property
    def undetectable(self) -> tuple[str, ...]:
        """Names of which nothing is detected, at any order of a gear."""
        return undetectable(self.detectabilities)


def judged(expected: ExpectedPosterior) -> Judgement:
    """Return the judgement of an expected posterior."""
    chosen, detectabilities = detectabilities_of(expected)
    return Judgement(tuple(detectabilities), tuple(_close_pairs(expected, chosen, detectabilities)))


def separation_sigma(expected: ExpectedPosterior, pair: ClosePair) -> float:
    """Return the sigmas by which the two names of a pair are separated, whichever of them is present."""
    first, second = pair.first, pair.second
    return min(expected.separation_sigma(first, second), expected.separation_sigma(second, first))


def _close_pairs(
    expected: ExpectedPosterior, chosen: Sequence[Candidate], detectabilities: Sequence[Detectability]
) -> list[ClosePair]:
    """Return the pairs of names separated by less than SEPARABLE in either direction, the closest first. Orders of one
    gear are not rivals."""
    seen = [k for k, one in enumerate(detectabilities) if not one.hidden]
    sizes = [max(expected.least, detectabilities[k].limit / healthy_size(detectabilities[k].effect)) for k in seen]
    found: dict[tuple[str, str], ClosePair] = {}
    for i, j in expected.close_pairs([chosen[k] for k in seen], np.array(sizes)):
        bare = ClosePair((chosen[seen[i]], chosen[seen[j]]), (sizes[i], sizes[j]), 0.0)
        one = replace(bare, sigma=separation_sigma(expected, bare))
        if one.sigma < SEPARABLE:
            known = found.get(one.names)
            nearer = one if known is None or one.sigma < known.sigma else known
            found[one.names] = replace(nearer, others=known.others + 1 if known else 0)
    return sorted(found.values(), key=lambda one: one.sigma)


def _at_size(candidate: Candidate, size: float) -> tuple[Effect, ...]:
    return tuple(scaled(healthy(effect), size) for effect in candidate.effects)
