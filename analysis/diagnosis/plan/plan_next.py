"""Last stage of a diagnosis: the tests that would decide open effects, and the actions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial

from analysis.diagnosis.evidence.gather import Evidence
from analysis.diagnosis.fit.fit_evidence import Fit
from analysis.diagnosis.judge.act_list import CHECK_STATED, EARLY, EARLY_COMMANDED, JudgedPlace, acts_of
from analysis.diagnosis.judge.acts import Act
from analysis.diagnosis.judge.judge import Findings
from analysis.diagnosis.judge.result import Diagnosis, Named, NextTest, fault_rivals
from analysis.diagnosis.judge.validate import Validation
from analysis.diagnosis.judge.verdict import ambiguous_names
from analysis.diagnosis.plan.expected import is_separable
from analysis.diagnosis.plan.further_tests import FurtherTests, possible_tests, shortest, sigma_between
from analysis.diagnosis.plan.naming_tests import naming_tests
from analysis.procedures.shared.test_kind import facts_of
from analysis.runs.loading import Measured
from analysis.runs.tables import COMMANDED
from rigs.errors import FileError
from rigs.schema.effect import name_of

_FEW_TESTS = 3
"""Number of further tests listed with the reason why the robot cannot drive them."""


def plan_next(
    diagnosis: Diagnosis,
    evidence: Evidence,
    fit: Fit,
    validation: Validation,
    findings: Findings,
    progress: Callable[[str], None],
) -> Diagnosis:
    """Return the diagnosis with the next test, if an effect has a rival, and the actions."""
    further = _further_tests(evidence, fit)
    next_test, why_none = None, list[str]()
    condition, is_decidable = diagnosis.condition, diagnosis.runs_to_decide is None
    if condition == "ambiguous" or (condition == "undecided" and is_decidable):
        progress("choosing a test that separates the rivals")
        next_test, why_none = _next_test(diagnosis.effects, further)
    asks = condition not in ("not_testable_here", "out_of_range") and is_decidable and not diagnosis.given
    judged_runs = validation.sound, validation.elsewhere
    named = list(diagnosis.effects)
    tests = naming_tests(further, fit.result, diagnosis.budget, named, judged_runs) if asks else []
    runs = validation.elsewhere or validation.judges or validation.sound
    place, gaps = diagnosis.accuracy.place, validation.gaps
    judged = JudgedPlace(place, validation.fitted, runs, validation.stages, gaps.judged, gaps.predicted_um)
    stated = (CHECK_STATED,) if diagnosis.contradictions else ()
    before = (*stated, *(_before(evidence.uses.used) if findings.early else ()))
    acts = acts_of(diagnosis, judged, tests, before)
    return replace(diagnosis, next_test=next_test, doubts=(*diagnosis.doubts, *why_none), acts=acts)


def _further_tests(evidence: Evidence, fit: Fit) -> FurtherTests:
    """Return the function that lists the possible and impossible further tests, computed once if it is called."""
    result = fit.result
    tests = tuple(dict.fromkeys(run.run.manifest.test for run in evidence.uses.used))
    return cache(
        partial(
            possible_tests, evidence.rig, tests, result.blocks_as_shown, result.linear.setups, result.state.level,
            noise_share=result.noise_share,
        )
    )  # fmt: skip


def _before(used: Sequence[Measured]) -> tuple[Act, ...]:
    """Return the first action if joints were read too early, depending on the presence of commanded angles."""
    tables = [run.run.table for run in used if facts_of(run.table.test).of_tracker]
    commanded = any(table is not None and COMMANDED[0] in table.column_names for table in tables)
    return (EARLY_COMMANDED if commanded else EARLY,)


def _next_test(named: Sequence[Named], further: FurtherTests) -> tuple[NextTest | None, list[str]]:
    """Return the shortest test that, together with the existing runs, separates the first ambiguous effect from its
    closest rival; otherwise a doubt.
    """
    open_ones = [(name, name.rivals) for name in ambiguous_names(named)]
    open_ones += [(name, tuple(fault_rivals(name))) for name in named]
    name, rivals = next(((name, rivals) for name, rivals in open_ones if rivals), (None, ()))
    if name is None:
        return None, []
    try:
        possible, impossible = further()
    except FileError as error:
        return None, [f"further tests are not possible with this rig file: {error}"]
    if not possible:
        reasons = "; ".join(f"{test}: {why}" for test, why in impossible[:_FEW_TESTS])
        return None, [f"further tests are not possible with this rig file ({reasons or 'it declares only these'})"]
    best = shortest(possible, sigma_between(name.effect, rivals[0].effect), is_separable)
    if best is None:
        return None, [
            f"other tests do not separate {name_of(name.effect)} from the rivals: the corrections have the same effect"
        ]
    test, sigma = best
    return NextTest(test.test, test.why, float(sigma)), []
