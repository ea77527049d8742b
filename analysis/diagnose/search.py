"""Which effects explain the residual: proposed by linear evidence, judged by refined fits, defended against rivals.

Every effect is also there as a healthy arm's share of it (`Background`), so a little of everything draws no name. A
proposal is the candidate whose response explains most of what is left; it is refined with its shape, and kept when the
evidence of the whole set grows by more than the price of a name. Each name must then stand against its rivals: other
candidates refined in its place. What a set-up term could do as well is not testable, and no candidate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.diagnose.candidates import Candidate
from analysis.diagnose.refine import Background, Refined, refine
from analysis.diagnose.response import Response
from analysis.kinematics.arm import Array
from rigs.effects import Effect, healthy_size, size_field

PRICE = 3.0
"""Log odds that a name must win beside the number of candidates: 20 to 1."""
DEPTH = 4
_TRIED = 4
"""Proposals that are refined before the best is taken."""
_RIVALS = 5
_OWN_SHARE = 0.02


@dataclass(frozen=True)
class Rival:
    """Another candidate in the place of a name, and its share of the evidence there."""

    name: str
    effect: Effect
    posterior: float


@dataclass(frozen=True)
class Explained:
    """The names given, in order, each with its posterior and rivals; refined: their sizes and shapes."""

    names: tuple[str, ...]
    refined: Refined
    posterior: tuple[float, ...]
    rivals: tuple[tuple[Rival, ...], ...]


class Search:
    """The candidates' signatures on one response."""

    def __init__(self, response: Response, candidates: Sequence[Candidate]) -> None:
        own = response.own([candidate.effect for candidate in candidates])
        self.not_testable = [c.name for c, share in zip(candidates, own, strict=True) if share < _OWN_SHARE]
        self.response = response
        self.candidates = candidates = [c for c, share in zip(candidates, own, strict=True) if share >= _OWN_SHARE]
        effects = [effect for candidate in candidates for effect in candidate.effects]
        self.owner = np.repeat(np.arange(len(candidates)), [len(c.effects) for c in candidates])
        self.G = response.of(effects)
        share = np.concatenate([np.full(len(c.effects), c.share / np.sqrt(len(c.effects))) for c in candidates])
        self._share = share
        self.background = Background(self.G, share)
        self.price = PRICE + float(np.log(len(candidates)))
        self._weighted = self.background.weighted(self.G)
        self._known: dict[frozenset[str], Refined] = {}

    def explain(self) -> Explained:
        """Names, as many as pay for themselves."""
        names: tuple[str, ...] = ()
        now = self._refined(names, ())
        for _ in range(DEPTH):
            tried = [self._joined(names, now, k) for k in self.proposals(now.left, set(names))[:_TRIED]]
            best = max(tried, key=lambda entry: entry[1].evidence, default=None)
            if best is None or best[1].evidence - now.evidence < self.price:
                break
            names, now = self._settled(*best)
        return self._defended(names, now)

    def proposals(self, left: Array, taken: set[str]) -> list[int]:
        """Candidates by how much of what is left their signatures explain, best first."""
        b = self._weighted.T @ left
        gain = np.empty(len(self.candidates))
        for k, candidate in enumerate(self.candidates):
            cols = np.flatnonzero(self.owner == k)
            A = self._weighted[:, cols].T @ self.G[:, cols] + 1e-12 * np.eye(len(cols))
            size = np.linalg.solve(A, b[cols])
            # The background holds the candidate's own healthy share: taken out here, for it is on trial.
            without = np.linalg.solve(np.eye(len(cols)) - self._share[cols[0]] ** 2 * A, b[cols])
            one_sided = len(cols) == 1 and _one_sided(candidate.effect)
            gain[k] = 0.0 if one_sided and size[0] <= 0 else float(without @ size)
        order = np.argsort(-gain)
        return [int(k) for k in order if self.candidates[k].name not in taken and gain[k] > 2 * self.price]

    def _joined(self, names: tuple[str, ...], now: Refined, k: int) -> tuple[tuple[str, ...], Refined]:
        start = self._start(k, now.left)
        return (*names, self.candidates[k].name), self._refined(
            (*names, self.candidates[k].name), (*now.effects, start)
        )

    def _refined(self, names: tuple[str, ...], effects: Sequence[Effect]) -> Refined:
        key = frozenset(names)
        if key not in self._known:
            self._known[key] = refine(self.response, self.background, effects)
        return self._known[key]

    def _settled(self, names: tuple[str, ...], now: Refined) -> tuple[tuple[str, ...], Refined]:
        """Drop what no longer pays for itself."""
        for place in range(len(names) - 1):
            rest = names[:place] + names[place + 1 :]
            without = self._refined(rest, now.effects[:place] + now.effects[place + 1 :])
            if now.evidence - without.evidence < self.price:
                return self._settled(rest, without)
        return names, now

    def _defended(self, names: tuple[str, ...], now: Refined) -> Explained:
        """Every name against its rivals; a rival that does better takes its place, once."""
        posterior, rivals = [], []
        for place in range(len(names)):
            found = self._rivals(names, now, place)
            best = max(found, key=lambda entry: entry[1].evidence, default=None)
            if best is not None and best[1].evidence > now.evidence + 0.5:
                return self._defended(*best)
            weight = np.exp(np.array([0.0, *(one.evidence - now.evidence for _, one in found)]))
            share = weight / weight.sum()
            posterior.append(float(share[0]))
            others = [
                Rival(rival[-1], one.effects[-1], float(p)) for (rival, one), p in zip(found, share[1:], strict=True)
            ]
            rivals.append(
                tuple(sorted((one for one in others if one.posterior > 1e-3), key=lambda one: -one.posterior))
            )
        return Explained(names, now, tuple(posterior), tuple(rivals))

    def _rivals(self, names: tuple[str, ...], now: Refined, place: int) -> list[tuple[tuple[str, ...], Refined]]:
        rest, kept = names[:place] + names[place + 1 :], now.effects[:place] + now.effects[place + 1 :]
        left = self.response.y - self.response.of(kept).sum(axis=1)
        found = []
        for k in self.proposals(left, set(names))[:_RIVALS]:
            effects = (*kept, self._start(k, left))
            rival = (*rest, self.candidates[k].name)
            found.append((rival, self._refined(rival, effects)))
        return found

    def _start(self, k: int, left: Array) -> Effect:
        """The candidate at the size, and the phase, that explains most of what is left."""
        cols = np.flatnonzero(self.owner == k)
        A = self._weighted[:, cols].T @ self.G[:, cols]
        size = np.linalg.solve(A + 1e-12 * np.eye(len(cols)), self._weighted[:, cols].T @ left)
        effect: Any = self.candidates[k].effect
        field, healthy = size_field(effect), healthy_size(effect)
        if len(cols) == 2:
            phase = float(np.degrees(np.arctan2(size[1], size[0])))
            return effect.model_copy(update={field: float(np.hypot(*size)) * healthy, "phase_deg": phase})  # type: ignore[no-any-return]
        return effect.model_copy(update={field: float(size[0]) * healthy})  # type: ignore[no-any-return]


def _one_sided(effect: Effect) -> bool:
    """A width or a softness cannot be negative."""
    metadata = type(effect).model_fields[size_field(effect)].metadata
    return any(getattr(bound, "ge", -1.0) == 0 for bound in metadata)
