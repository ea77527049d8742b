"""Last stage of a diagnosis: the tests that would decide open effects, and the actions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from analysis.diagnosis.evidence.gather import Evidence
from analysis.diagnosis.fit.fit_evidence import Fit
from analysis.diagnosis.judge.act_list import CHECK_STATED, EARLY, EARLY_COMMANDED, JudgedPlace, acts_of
from analysis.diagnosis.judge.acts import Act
from analysis.diagnosis.judge.result import Diagnosis, Named, fault_rivals
from analysis.diagnosis.judge.validate import Validation
from analysis.diagnosis.judge.verdict import ambiguous_names
from analysis.diagnosis.plan.further_tests import PossibleTest, possible_tests
from analysis.diagnosis.plan.naming_tests import NamingTests, naming_tests, parts_to_identify
from analysis.procedures.shared.test_kind import facts_of
from analysis.runs.loading import Measured
from analysis.runs.tables import COMMANDED
from rigs.effects import Effect
from rigs.errors import FileError
from rigs.schema.effect import name_of


def plan_next(
    diagnosis: Diagnosis,
    evidence: Evidence,
    fit: Fit,
    validation: Validation,
    progress: Callable[[str], None],
    *,
    early: bool,
) -> Diagnosis:
    """Return the diagnosis with the next test, if an effect has a rival, and the actions."""
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
    best = NamingTests(possible).for_rivals(*pair) if pair else None
    why_none = [none or _ALIKE.format(name_of(pair[0]))] if pair and best is None else []
    tests = naming_tests(asked, possible, fit.result, (validation.fitted.runs, validation.elsewhere)) if asked else []
    runs = validation.elsewhere or validation.judges or validation.fitted.runs
    place, gaps = diagnosis.accuracy.place, validation.gaps
    judged = JudgedPlace(place, validation.fitted, runs, validation.stages.calibrated, gaps.judged, gaps.predicted_um)
    stated = (CHECK_STATED,) if diagnosis.contradictions else ()
    before = (*stated, *(_before(evidence.uses.used) if early else ()))
    acts = acts_of(diagnosis, judged, tests, before)
    return replace(diagnosis, next_test=best and best[0], doubts=(*diagnosis.doubts, *why_none), acts=acts)


_ALIKE = "other tests do not separate {} from the rivals: the corrections have the same effect"


def _possible_tests(evidence: Evidence, fit: Fit) -> tuple[list[PossibleTest], str]:
    """Return the further tests that the arm can drive, and the reason if there are none."""
    result, words = fit.result, "further tests are not possible with this rig file"
    tests = tuple(dict.fromkeys(run.run.manifest.test for run in evidence.uses.used))
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
    """Return the first action if joints were read too early, depending on the presence of commanded angles."""
    tables = [run.run.table for run in used if facts_of(run.table.test).of_tracker]
    commanded = any(table is not None and COMMANDED[0] in table.column_names for table in tables)
    return (EARLY_COMMANDED if commanded else EARLY,)


def _open_pair(named: Sequence[Named]) -> tuple[Effect, Effect] | None:
    """Return the first ambiguous effect with its closest rival."""
    open_ones = [(name, name.rivals) for name in ambiguous_names(named)]
    open_ones += [(name, tuple(fault_rivals(name))) for name in named]
    return next(((name.effect, rivals[0].effect) for name, rivals in open_ones if rivals), None)
