"""The test that would name a part of the error: which, how many minutes it takes, and how sure it makes.

Of an effect with a rival it is the test that distinguishes both; of a group the one by which its likeliest member is
known best, beside everything else that may be present. Runs of another place that only judged may do it without
driving.
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
from analysis.diagnosis.judge.result import CERTAIN_ODDS, BudgetPart, Named, fault_rivals, is_open, likely_rivals
from analysis.diagnosis.plan.detectability import FurtherTests, PossibleTest, shortest, sigma_between
from analysis.diagnosis.plan.expected import SEPARABLE, ExpectedPosterior, without_bands
from rigs.effects import Effect
from rigs.errors import FileError
from rigs.schema.effect import is_play, label_of, name_of, size_of

JOINED = "--unseen"
"""The test that takes no driving: the runs that only judged, used as well."""
_MUCH = 0.1
"""Share of the error from which a part is worth a test."""


@dataclass(frozen=True)
class NamingTests:
    """The tests that may name parts of the error beside the runs used."""

    possible: Sequence[PossibleTest]

    def for_rivals(self, effect: Effect, rival: Effect) -> tuple[NamingTest, Cost] | None:
        """Return the test that separates an effect from its rival, the cheapest of those that do it for certain; None
        where none does."""
        return self._cheapest(sigma_between(effect, rival), 1, (name_of(effect), name_of(rival)))

    def for_member(self, effect: Effect, among: int) -> tuple[NamingTest, Cost] | None:
        """Return the test by which an effect among so many is known best at its size; None where none names it."""

        def sigma(test: PossibleTest) -> float:
            alike = [form for form in test.expected.candidates if form.name == name_of(effect)]
            sd = test.expected.sd(min(alike, key=lambda form: form.size)) if alike else np.inf
            return abs(size_of(effect)) / sd

        return self._cheapest(sigma, among, (label_of(effect),))

    def _cheapest(
        self, sigma: Callable[[PossibleTest], float], among: int, names: tuple[str, ...]
    ) -> tuple[NamingTest, Cost] | None:
        named = shortest(self.possible, sigma, lambda sigmas: _odds(sigmas, among) >= CERTAIN_ODDS)
        if named is None:
            return None
        best, sigmas = named
        test = NamingTest(best.test, best.why, float(sigmas), _odds(sigmas, among), names)
        return test, Cost(best.minutes, best.programs, best.set_ups)


def _odds(sigma: float, among: int) -> float:
    """Return the odds that are expected of a cause that is known by so many sigmas among so many others."""
    return float(1 / (1 + among * np.exp(-0.5 * min(sigma, SEPARABLE * 10) ** 2)))


def naming_tests(
    further: FurtherTests,
    result: SearchResult,
    budget: Sequence[BudgetPart],
    named: Sequence[Named],
    judges: tuple[Sequence[ObservedRun], Sequence[ObservedRun]],
) -> list[tuple[int, NamingTest, Cost]]:
    """Return the test that names each part of the budget that needs one, by its index: a name that stands and has a
    rival, and a group. `judges` are the runs used, and those of another place that only judged; readings are (m, k)."""
    asked: list[tuple[int, Effect, Effect | None]] = []  # parts by their index, what may be there, and its rival
    for k, part in enumerate(budget):
        name = None if part.index is None else named[part.index]
        if name is None or is_open(part, name):
            likeliest = [name.effect] if name else [member.effect for member in part.members[:1] if not part.cause]
            asked += [(k, effect, None) for effect in likeliest if not is_play(effect)]
        elif rivals := fault_rivals(name):
            asked.append((k, name.effect, rivals[0].effect))
        elif name.stands and part.share > _MUCH and likely_rivals(name):
            asked.append((k, name.effect, name.rivals[0].effect))
    if not asked:
        return []
    try:
        possible, _ = further()
    except FileError:
        possible = []
    used, elsewhere = judges
    if elsewhere:  # the test that uses them as well takes no driving
        setups = {**fit_run_setups(elsewhere)[0], **result.linear.setups}
        linear = linearise(without_bands(blocks_of([*used, *elsewhere], setups)), setups)
        expected = ExpectedPosterior(linear, result.state.level)
        possible = [PossibleTest(JOINED, "they were driven already", expected, 0.0, 0, 0), *possible]
    planned_tests, among = NamingTests(possible), len(result.columns.forms)
    tests = []
    for k, effect, rival in asked:
        planned = planned_tests.for_rivals(effect, rival) if rival else planned_tests.for_member(effect, among)
        tests += [(k, *planned)] if planned else []
    return tests
