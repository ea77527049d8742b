"""Tests that identify a part of the error: choice, duration, and expected certainty.

For an effect with a rival, the test separates both. For a group, the test determines the likeliest member best in the
presence of all other terms. Runs of a different place used for validation may suffice, without driving.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.evidence.blocks import blocks_of
from analysis.diagnosis.evidence.observation import ObservedRun
from analysis.diagnosis.evidence.setups import fit_run_setups
from analysis.diagnosis.fit.responses import linearise
from analysis.diagnosis.fit.search import SearchResult
from analysis.diagnosis.judge.acts import Cost, NamingTest
from analysis.diagnosis.judge.probability import CONFIRMED
from analysis.diagnosis.judge.result import LEAST_SHARE, BudgetPart, Named, fault_rivals, is_open, likely_rivals
from analysis.diagnosis.plan.expected import SEPARABLE, ExpectedPosterior, without_bands
from analysis.diagnosis.plan.further_tests import PossibleTest, shortest, sigma_between
from rigs.effects import Effect
from rigs.schema.effect import is_play, label_of, name_of, size_of

JOINED = "--unseen"
"""Test without driving: runs previously used only for validation."""


@dataclass(frozen=True)
class NamingTests:
    """Tests that can identify parts of the error in addition to the runs used."""

    possible: Sequence[PossibleTest]

    def for_rivals(self, effect: Effect, rival: Effect) -> tuple[NamingTest, Cost] | None:
        """Return the cheapest test that certainly separates an effect from a rival; None if no test does."""
        return self._cheapest(sigma_between(effect, rival), 1, (name_of(effect), name_of(rival)))

    def for_member(self, effect: Effect, among: int) -> tuple[NamingTest, Cost] | None:
        """Return the test that determines an effect, among `among` candidates, best at the fitted size; None if no
        test identifies it.
        """

        def sigma(test: PossibleTest) -> float:
            alike = [form for form in test.expected.candidates if form.name == name_of(effect)]
            sd = test.expected.sd(min(alike, key=lambda form: form.size)) if alike else np.inf
            return abs(size_of(effect)) / sd

        return self._cheapest(sigma, among, (label_of(effect),))

    def _cheapest(
        self, sigma: Callable[[PossibleTest], float], among: int, names: tuple[str, ...]
    ) -> tuple[NamingTest, Cost] | None:
        named = shortest(self.possible, sigma, lambda sigmas: _odds(sigmas, among) >= CONFIRMED)
        if named is None:
            return None
        best, sigmas = named
        test = NamingTest(best.test, best.why, float(sigmas), _odds(sigmas, among), names)
        return test, best.cost


def _odds(sigma: float, among: int) -> float:
    """Return the expected odds of a cause with a significance in sigmas among other candidates."""
    return float(1 / (1 + among * np.exp(-0.5 * min(sigma, SEPARABLE * 10) ** 2)))


Question = tuple[int, Effect, Effect | None]
"""A part of the budget by index, its possible cause, and a rival of it, if any."""


def parts_to_identify(budget: Sequence[BudgetPart], named: Sequence[Named]) -> list[Question]:
    """Return the parts of the budget that need a test: confirmed effects with a rival, and groups."""
    asked: list[Question] = []
    for k, part in enumerate(budget):
        name = None if part.index is None else named[part.index]
        if name is None or is_open(part, name):
            likeliest = [name.effect] if name else [member.effect for member in part.members[:1] if not part.cause]
            asked += [(k, effect, None) for effect in likeliest if not is_play(effect)]
        elif rivals := fault_rivals(name):
            asked.append((k, name.effect, rivals[0].effect))
        elif name.is_confirmed and part.share > LEAST_SHARE and likely_rivals(name):
            asked.append((k, name.effect, name.rivals[0].effect))
    return asked


def naming_tests(
    asked: Sequence[Question],
    possible: Sequence[PossibleTest],
    result: SearchResult,
    judges: tuple[Sequence[ObservedRun], Sequence[ObservedRun]],
) -> list[tuple[int, NamingTest, Cost]]:
    """Return the test for each part of the budget that needs a test, by index, if a possible test suffices.

    `judges`: runs used, and validation runs of a different place; readings are (m, k).
    """
    used, elsewhere = judges
    if elsewhere:  # no driving is needed if these runs are also used
        setups = {**fit_run_setups(elsewhere)[0], **result.linear.setups}
        linear = linearise(without_bands(blocks_of([*used, *elsewhere], setups)), setups)
        expected = ExpectedPosterior(linear, result.state.level)
        possible = [PossibleTest(JOINED, "they were driven already", expected, Cost(0.0)), *possible]
    planned_tests, among = NamingTests(possible), len(result.columns.forms)
    tests = []
    for k, effect, rival in asked:
        planned = planned_tests.for_rivals(effect, rival) if rival else planned_tests.for_member(effect, among)
        tests += [(k, *planned)] if planned else []
    return tests
