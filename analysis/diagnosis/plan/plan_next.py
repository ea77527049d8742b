"""Last stage of a diagnosis: the tests that would decide open effects, and the actions.

For an effect with a rival, a test separates both. For a group, it determines the likeliest member best in the presence
of all other terms. Runs of a different place used for validation may suffice, without driving.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.evidence.blocks import blocks_of
from analysis.diagnosis.evidence.gather import Evidence
from analysis.diagnosis.evidence.observation import ObservedRun
from analysis.diagnosis.evidence.setups import fit_run_setups
from analysis.diagnosis.fit.fit_evidence import Fit
from analysis.diagnosis.fit.responses import linearise
from analysis.diagnosis.fit.search import SearchResult
from analysis.diagnosis.fit.selection_state import LEAST_SHARE
from analysis.diagnosis.judge.act_list import CHECK_STATED, EARLY, EARLY_COMMANDED, JudgedPlace, acts_of
from analysis.diagnosis.judge.acts import Act, Cost, NamingTest, Reason
from analysis.diagnosis.judge.budget_part import BudgetPart
from analysis.diagnosis.judge.certainty import fault_rivals, is_open, likely_rivals
from analysis.diagnosis.judge.named import Named
from analysis.diagnosis.judge.probability import CONFIRMED
from analysis.diagnosis.judge.result import Diagnosis
from analysis.diagnosis.judge.validate import Validation
from analysis.diagnosis.judge.verdict import ambiguous_names
from analysis.diagnosis.plan.expected import SEPARABLE, ExpectedPosterior, without_bands
from analysis.diagnosis.plan.further_tests import PossibleTest, possible_tests, shortest, sigma_between
from analysis.procedures.shared.test_kind import facts_of
from analysis.runs.loading import Measured
from analysis.runs.tables import COMMANDED
from rigs.effects import Effect
from rigs.errors import FileError
from rigs.schema.effect import is_play, label_of, name_of, size_of

JOINED = "--unseen"
"""Test without driving: runs previously used only for validation."""


def _naming_test(
    possible: Sequence[PossibleTest], effect: Effect, rival: Effect | None, among: int
) -> tuple[NamingTest, Cost] | None:
    """The cheapest test that certainly separates an effect from a rival, or, without one, identifies it at its fitted
    size among `among` candidates; None if no test does.
    """

    def sigma_of_size(test: PossibleTest) -> float:
        alike = [form for form in test.expected.candidates if form.name == name_of(effect)]
        sd = test.expected.sd(min(alike, key=lambda form: form.size)) if alike else np.inf
        return abs(size_of(effect)) / sd

    def odds(sigma: float) -> float:
        return float(1 / (1 + (1 if rival else among) * np.exp(-0.5 * min(sigma, SEPARABLE * 10) ** 2)))

    sigma = sigma_between(effect, rival) if rival else sigma_of_size
    named = shortest(possible, sigma, lambda sigmas: odds(sigmas) >= CONFIRMED)
    if named is None:
        return None
    best, sigmas = named
    names = (name_of(effect), name_of(rival)) if rival else (label_of(effect),)
    return NamingTest(best.test, best.why, float(sigmas), odds(sigmas), names), best.cost


Question = tuple[int, Effect, Effect | None]
"""A part of the budget by index, its possible cause, and a rival of it, if any."""


def parts_to_identify(budget: Sequence[BudgetPart], named: Sequence[Named]) -> list[Question]:
    """The parts of the budget that need a test: confirmed effects with a rival, and groups."""
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
    """The test for each part of the budget that needs one, by index, if a possible test suffices. `judges`: runs used,
    and validation runs of a different place.
    """
    used, elsewhere = judges
    if elsewhere:  # no driving is needed if these runs are also used
        setups = {**fit_run_setups(elsewhere)[0], **result.linear.setups}
        linear = linearise(without_bands(blocks_of([*used, *elsewhere], setups)), setups)
        expected = ExpectedPosterior(linear, result.state.level)
        possible = [PossibleTest(JOINED, "they were driven already", expected, Cost(0.0)), *possible]
    tests = []
    for k, effect, rival in asked:
        planned = _naming_test(possible, effect, rival, len(result.columns.forms))
        tests += [(k, *planned)] if planned else []
    return tests


def plan_next(
    diagnosis: Diagnosis,
    evidence: Evidence,
    fit: Fit,
    validation: Validation,
    progress: Callable[[str], None],
    *,
    early: bool,
) -> Diagnosis:
    """Add the next test, if an effect has a rival, and the actions."""
    condition, is_decidable = diagnosis.condition, diagnosis.runs_to_decide is None
    pair = None
    if condition == "ambiguous" or (condition == "undecided" and is_decidable):
        pair = _open_pair(diagnosis.effects)
    asks = condition not in ("not_testable_here", "out_of_range") and is_decidable and not diagnosis.given
    asked = parts_to_identify(diagnosis.budget, diagnosis.effects) if asks else []
    possible, none = list[PossibleTest](), ""
    if pair or asked:
        progress("choosing a test that separates the rivals")
        possible, none = _possible_tests(evidence, fit)
    best = _naming_test(possible, *pair, 1) if pair else None
    why_none = [none or _ALIKE.format(name_of(pair[0]))] if pair and best is None else []
    tests = naming_tests(asked, possible, fit.result, (validation.fitted.runs, validation.elsewhere)) if asked else []
    runs = validation.elsewhere or validation.judges or validation.fitted.runs
    place, gaps = diagnosis.accuracy.place, validation.gaps
    predicts = gaps.predicted_um is not None and validation.places is not None and validation.places.is_enough
    judged = JudgedPlace(
        place, validation.fitted, runs, validation.calibrated, gaps.judged, gaps.predicted_um, gaps.predicted_u_um,
        is_validated=predicts,
    )  # fmt: skip
    stated = (CHECK_STATED,) if diagnosis.contradictions else ()
    before = (*stated, *(_before(evidence.used) if early else ()))
    acts = acts_of(diagnosis, judged, tests, before)
    diagnosis = replace(diagnosis, next_test=best and best[0], doubts=(*diagnosis.doubts, *why_none), acts=acts)
    return _with_measure_first(diagnosis)


_ASKS_FIRST: tuple[Reason, ...] = ("elsewhere", "few_runs", "revisit", "commanded", "early")
"""Reasons of a first act that asks for other readings because those used do not show the error of the model."""


def _with_measure_first(diagnosis: Diagnosis) -> Diagnosis:
    """Store in the calibrated model that the first act asks for other readings before a correction."""
    calibrated, first = diagnosis.calibrated, diagnosis.next_act
    if first is None or first.why not in _ASKS_FIRST or calibrated is None or calibrated.judged is None:
        return diagnosis
    judged = calibrated.judged.model_copy(update={"measure_first": True, "measure_why": first.why})
    return replace(diagnosis, calibrated=calibrated.with_values(judged=judged))


_ALIKE = "other tests do not separate {} from the rivals: the corrections have the same effect"


def _possible_tests(evidence: Evidence, fit: Fit) -> tuple[list[PossibleTest], str]:
    result, words = fit.result, "further tests are not possible with this rig file"
    tests = tuple(dict.fromkeys(run.run.manifest.test for run in evidence.used))
    try:
        possible, impossible = possible_tests(
            evidence.rig, tests, result.blocks_as_shown, result.linear.setups, result.state.level,
            noise_share=result.noise_share,
        )  # fmt: skip
    except FileError as error:
        return [], f"{words}: {error}"
    reasons = "; ".join(f"{test}: {why}" for test, why in impossible)
    return possible, "" if possible else f"{words} ({reasons or 'it declares only these'})"


def _before(used: Sequence[Measured]) -> tuple[Act, ...]:
    """The first action if joints were read too early, depending on the presence of commanded angles."""
    tables = [run.run.table for run in used if facts_of(run.table.test).of_tracker]
    commanded = any(table is not None and COMMANDED[0] in table.column_names for table in tables)
    return (EARLY_COMMANDED if commanded else EARLY,)


def _open_pair(named: Sequence[Named]) -> tuple[Effect, Effect] | None:
    open_ones = [(name, name.rivals) for name in ambiguous_names(named)]
    open_ones += [(name, tuple(fault_rivals(name))) for name in named]
    return next(((name.effect, rivals[0].effect) for name, rivals in open_ones if rivals), None)
