"""Names defended on the simulator: each must pay for itself, no more may pay, and rivals are tried in its place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.diagnose.candidates import name_of
from analysis.diagnose.diagnosis import ODDS, Rival
from analysis.diagnose.evidence import Background
from analysis.diagnose.linear import Linear
from analysis.diagnose.refine import Refined, refine
from analysis.diagnose.search import QUIET, Search
from rigs.effect import identity
from rigs.effects import Effect, healthy_size, size_field

_RIVALS = 3
_NEAR = 10.0
_LARGE = 600.0
"""Log evidence of a name so large that linear evidence tells little of its rivals: the first two are refined."""
_ROUNDS = 3
_LEAST = 1e-4
"""A rival's share of the evidence that is worth telling."""


@dataclass(frozen=True)
class Explained:
    """The effects named, with sizes and shapes; each with its posterior among its rivals; level of the background, and
    the background."""

    refined: Refined
    posterior: tuple[float, ...]
    rivals: tuple[tuple[Rival, ...], ...]
    level: float
    background: Background

    @property
    def names(self) -> tuple[str, ...]:
        """As an answer gives them."""
        return tuple(name_of(effect) for effect in self.refined.effects)

    @property
    def doubtful(self) -> tuple[int, ...]:
        """Which names have rivals that cannot be dismissed."""
        return tuple(k for k, share in enumerate(self.posterior) if share < ODDS / (1 + ODDS))


class Explainer:
    """Names for what a linearisation leaves."""

    def __init__(self, linear: Linear, search: Search) -> None:
        self.linear, self.search = linear, search
        self.level = QUIET[0]
        self.background: Background = search.background(self.level)
        self._known: dict[tuple[Effect, ...], Refined] = {}

    def explain(self, levels: Sequence[float]) -> Refined:
        """The names that pay for themselves, at the best of some background levels."""
        found = self.search.best(levels)
        self.level = found.level
        self.background = self.search.background(found.level)
        self._known.clear()
        now = self._refined([self.search.start(k, size) for k, size in zip(found.chosen, found.sizes, strict=True)])
        for _ in range(_ROUNDS):
            before = now.effects
            now = self._added(self._dropped(now))
            if [name_of(e) for e in now.effects] == [name_of(e) for e in before]:
                break
        return now

    def beyond_healthy(self, now: Refined) -> Refined:
        """Without the names that are no more than what a healthy arm shows, one after the other."""
        while True:
            sizes = [abs(getattr(e, size_field(e))) / healthy_size(e) for e in now.effects]
            least = min(sizes, default=np.inf)
            if least > 1:
                return now
            now = self._without(now, sizes.index(least))

    def score(self, now: Refined) -> float:
        """Log density of the residual with some names, prices paid."""
        return self.search.table(self.level).null + now.evidence - self.search.price * len(now.effects)

    def defended(self, now: Refined, rounds: int = _ROUNDS) -> Explained:
        """Every name against its rivals; one that does better takes its place."""
        posterior, rivals = [], []
        for place, effect in enumerate(now.effects):
            rest = self._without(now, place)
            gain = now.evidence - rest.evidence
            tried = [
                self._refined([*rest.effects, other])
                for rank, (other, linear_gain) in enumerate(self._proposals(rest, [name_of(effect)])[:_RIVALS])
                if linear_gain > gain - _NEAR or (gain > _LARGE and rank < 2)
            ]
            best = max(tried, key=lambda one: one.evidence, default=None)
            if best is not None and best.evidence > now.evidence + 0.1 and rounds:
                return self.defended(self._added(self._dropped(best)), rounds - 1)
            weight = np.exp(np.minimum([0.0, *(one.evidence - now.evidence for one in tried)], 50.0))
            share = weight / weight.sum()
            posterior.append(float(share[0]))
            others = [
                Rival(one.effects[-1], one.sd(len(one.effects) - 1), float(p))
                for one, p in zip(tried, share[1:], strict=True)
                if p > _LEAST
            ]
            rivals.append(tuple(sorted(others, key=lambda rival: -rival.posterior)))
        return Explained(now, tuple(posterior), tuple(rivals), self.level, self.background)

    def _refined(self, effects: Sequence[Effect]) -> Refined:
        key = tuple(identity(effect) for effect in effects)
        if key not in self._known:
            self._known[key] = refine(self.linear, self.background, effects)
        return self._known[key]

    def _without(self, now: Refined, place: int) -> Refined:
        return self._refined([*now.effects[:place], *now.effects[place + 1 :]])

    def _dropped(self, now: Refined) -> Refined:
        """Without names that no longer pay, the least first."""
        while now.effects:
            without = [self._without(now, place) for place in range(len(now.effects))]
            best = max(without, key=lambda one: one.evidence)
            if now.evidence - best.evidence >= self.search.price:
                break
            now = best
        return now

    def _added(self, now: Refined) -> Refined:
        """With one more name, where one pays beside shapes that are free."""
        if len(now.effects) >= self.search.depth:
            return now
        for effect, gain in self._proposals(now, ())[:2]:
            if gain < self.search.price:
                break
            more = self._refined([*now.effects, effect])
            if more.evidence - now.evidence >= self.search.price:
                return more
        return now

    def _proposals(self, now: Refined, but: Sequence[str]) -> list[tuple[Effect, float]]:
        """What could explain what some effects leave, with its linear evidence, best first; none of the names `but`."""
        search = self.search.beside(now.left, now.tangents)
        table = search.table(self.level)
        taken = {name_of(effect) for effect in now.effects} | set(but)
        gains = table.gains(())
        found: list[tuple[Effect, float]] = []
        seen: set[str] = set()
        for k in np.argsort(-gains):
            if not np.isfinite(gains[k]) or gains[k] < 0 or len(found) > _RIVALS:
                break
            if search.names[k] not in taken | seen:
                seen.add(search.names[k])
                found.append((search.start(int(k), table.sizes((int(k),))[0]), float(gains[k])))
        return found
