"""Diagnosis of runs: find the disagreement, identify the missing effects, validate them, and state the doubts."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial

import numpy as np

from analysis.diagnosis.evidence.blocks import Block
from analysis.diagnosis.evidence.link_swing import find_vibration
from analysis.diagnosis.evidence.observation import ObservedRun, rms
from analysis.diagnosis.evidence.prepared_runs import prepare_runs, without_wild
from analysis.diagnosis.evidence.setups import FittedRuns, fit_run_setups, with_effects, without_a_fold
from analysis.diagnosis.fit.out_of_range import OutOfRange, find_out_of_range
from analysis.diagnosis.fit.refine import ended_at_limit
from analysis.diagnosis.fit.responses import limits_um
from analysis.diagnosis.fit.search import SearchResult, early_readings, fit_given, search
from analysis.diagnosis.judge.act_list import EARLY, EARLY_COMMANDED, JudgedPlace, acts_of
from analysis.diagnosis.judge.acts import Act
from analysis.diagnosis.judge.budget import Budget, EffectChange, Measure, effect_changes
from analysis.diagnosis.judge.calibrated_model import calibrated_model
from analysis.diagnosis.judge.disagreement import staircase_of
from analysis.diagnosis.judge.misses import LeftOut, places_left_out, remains_of, widening_of
from analysis.diagnosis.judge.remains import Unexplained
from analysis.diagnosis.judge.residuals import bands_above_noise, curves_of, maps_of, places
from analysis.diagnosis.judge.result import Accuracy, Diagnosis, Gap, Named, NextTest, fault_rivals
from analysis.diagnosis.judge.unexplained import unexplained_of
from analysis.diagnosis.judge.validation import Stages, gap, held_out_gains, shows_noise, stages_of
from analysis.diagnosis.judge.verdict import (
    Gaps,
    accuracy_of,
    alone_out_of_range,
    ambiguous_names,
    as_scatter,
    condition_of,
    doubts_of_phases,
    judged_of,
    named_effects,
    named_vibration,
    needs_runs,
    remainder_of,
    runs_to_decide,
    shows_time,
    standing_of,
    standing_within,
    within_unexplained,
    without_useless,
)
from analysis.diagnosis.plan.detectability import FurtherTests, possible_tests, shortest, sigma_between
from analysis.diagnosis.plan.expected import is_separable
from analysis.diagnosis.plan.naming_tests import naming_tests
from analysis.robot.kinematics.arm import Array, rail_mm
from analysis.runs.loading import Measured
from analysis.runs.table_layout import COMMANDED
from rigs.effects import Effect
from rigs.effects import swing as vibration_at
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.effect import label_of, name_of

# ----------------------------------------------------------------------------------------------------------------------
# Doubts about a diagnosis.

_BETTER = 0.97
"""Ratio of the gap without an effect of the rig file to that with it, below which the effect is doubted. Chosen: 3 % of
the rms is more than a refitted set-up gains by chance."""


def doubts_of_runs(blocks: Sequence[Block]) -> tuple[str, ...]:
    """Return doubts about the runs, independent of their explanation."""
    doubts = []
    circles = [block for block in blocks if block.sampling]
    if circles and not circles[0].measured:
        slow = "" if shows_time(blocks) else ", and one lap cannot show slow changes such as warming"
        doubts.append(f"every circle was driven once: the noise of real cells is assumed{slow}; repeat each circle")
    if driven_once := ", ".join(block.name for block in circles if block.measured and block.count < 2):
        doubts.append(f"{driven_once} was driven once: its noise is assumed equal to that of the other circles")
    unrepeated = [block for block in blocks if not block.sampling and not block.measured]
    once = {block.name: shows_noise(block) for block in unrepeated if not block.table.kind.never_twice}
    doubts += [words for block in unrepeated if (words := block.table.kind.never_twice)]
    for name, shows in once.items():
        scatter = "is what the model leaves" if shows else "is assumed"
        doubts.append(f"no target of {name} was visited twice: its scatter {scatter}; visit targets again")
    ways: dict[str, set[str]] = {}
    for block in blocks:
        table = block.table
        doubts += table.kind.doubts(table, block.model, block.name)
        if direction := table.kind.direction(table):
            ways.setdefault(table.test, set()).add(direction)
    rails = [rail_mm(block.model.arm, block.table.q) for block in blocks if block.model.arm.rail is not None]
    if rails and np.ptp(stands := np.concatenate(rails)) == 0:
        doubts.append(
            f"the rail stood at {stands[0]:g} mm throughout, so the rail is not tested; measure along the rail"
        )
    for test, way in [(test, next(iter(seen))) for test, seen in ways.items() if len(seen) == 1]:
        doubts.append(f"{test} was driven {way} only: effects that change with the direction cannot be detected")
    if not circles:
        sides = any(block.table.kind.sides(block.table) is not None for block in blocks)
        back = "" if sides else ", or on how a joint turns back,"
        doubts.append(f"the robot stood at every reading: effects that depend on the speed{back} hardly show")
    return tuple(dict.fromkeys(doubts))  # each socket of a run is a separate block


def doubts_of_limits(names: Sequence[Named]) -> tuple[str, ...]:
    """Return a message for each confirmed name whose size reached the limit of fits."""
    doubts = []
    for named in names:
        if named.stands and ended_at_limit(named.effect):
            doubts.append(
                f"{label_of(named.effect)} ended at the limit of the size, so it is not to be trusted: check the rig "
                "file, the cables of the gauges and the placements, and repeat the diagnosis"
            )
    return tuple(doubts)


def doubts_of_rig(rig: Rig, fitted: FittedRuns) -> tuple[str, ...]:
    """Return a message for each effect of the rig file without which the model fits better."""
    if not rig.effects:
        return ()
    whole = rms(fitted.beside(())[1])
    doubts = []
    for k, effect in enumerate(rig.effects):
        bare = (*rig.effects[:k], *rig.effects[k + 1 :])
        without = rms(fit_run_setups([replace(run, model=replace(run.model, effects=bare)) for run in fitted.runs])[1])
        if without < _BETTER * whole:
            doubts.append(
                f"without {name_of(effect)} of the rig file the gap is {1e3 * without:.1f} instead of "
                f"{1e3 * whole:.1f} µm: remove it and repeat the diagnosis"
            )
    return tuple(doubts)


# ----------------------------------------------------------------------------------------------------------------------
# Diagnosis: find the disagreement, identify the missing effects, add them, and validate that the gap shrinks.
#
# runs → blocks with noise → effects selected by evidence and refined on the simulator → worth of each → verdict and
# validation

_FEW_TESTS = 3
"""Number of further tests listed with the reason why the robot cannot drive them."""


def diagnose(
    rig: Rig,
    used: Sequence[Measured],
    held_out: Sequence[Measured],
    unseen: Sequence[Measured],
    progress: Callable[[str], None],
    tolerance_um: float | None = None,
    given: Sequence[Effect] | None = None,
) -> Diagnosis:
    """Diagnose runs of one robot with the model of a rig, validated on held-out runs and unseen places.

    `tolerance_um`: largest accepted rms error of the readings (m, k); by default the limits of the rig file decide.
    `given`:
    effects to be fitted regardless of their significance, without a search. Without held-out runs, a fifth of the
    neighbourhoods
    of poses in joint space is held out. Raises FileError for runs of a different robot, or not readable as the stated
    test.
    """
    begin_s = time.perf_counter()
    progress("reading the runs")
    (runs, judges, elsewhere), placed = prepare_runs(rig, used, held_out, unseen)
    if not judges:
        runs, judges = without_a_fold(runs)
    _hold_enough(runs)
    result, beyond = _found_in(runs, given, progress)
    progress("validating on held-out runs")
    sound, wild = without_wild(runs, result.effects, "the runs used")
    fitted = FittedRuns(sound)
    stages = stages_of(fitted, result)
    # Relative to the calibrated model: named effects alone leave residuals that hide outliers of 1 mm.
    judges, wild_judges = without_wild(judges, stages.calibrated.effects, "held-out runs")
    elsewhere, wild_elsewhere = without_wild(elsewhere, stages.calibrated.effects, "the unseen place")
    judged_runs = ((sound, _names(used)), (judges, _names(held_out or used)), (elsewhere, _names(unseen)))
    left_out = places_left_out(result)
    whole = _gaps(judged_runs, stages, result, left_out)
    if whole.names_do_better:
        stages = stages.names_alone()
    gaps = _gaps(judged_runs, stages, result, left_out) if whole.names_do_better else whole
    changes = effect_changes(result)
    named, at_limits = _named_in(result, fitted, (runs, judges), changes, gaps.train, given=given is not None)
    named = alone_out_of_range(named, beyond, fitted) if beyond else named
    early = early_readings(result)
    standing = standing_of(rig, used) if tolerance_um is None else standing_within(tolerance_um, fitted)
    accuracy = accuracy_of(gaps, *standing)
    verdicts = _verdicts_of(rig, result, (whole, gaps), named, changes, accuracy, early=bool(early))
    verdicts = replace(verdicts, given=given is not None)
    verdicts = _completed(verdicts, result, left_out, beyond)
    wider = widening_of(left_out, judges, elsewhere, stages, result)
    judged = judged_of(verdicts, whole, gaps, wider.unexplained_mm)
    calibrated = None if beyond else calibrated_model(verdicts, result, used, runs, stages, wider, judged)
    remains = remains_of(result, left_out, _temperature(used))
    staircase = staircase_of(verdicts, result, stages, sound, judges, elsewhere)
    doubts = [*placed, *early, *wild, *wild_judges, *wild_elsewhere, *at_limits]
    doubts += [*doubts_of_runs(result.linear.blocks), *doubts_of_rig(rig, fitted)]
    kinds = tuple(dict.fromkeys(run.run.manifest.test for run in used))
    linear = result.linear
    further = cache(
        partial(
            possible_tests, rig, kinds, result.blocks_as_shown, linear.setups, result.state.level,
            noise_share=result.noise_share,
        )
    )  # fmt: skip
    next_test = None
    named = list(verdicts.effects)
    if verdicts.condition == "ambiguous" or (verdicts.condition == "undecided" and verdicts.runs_to_decide is None):
        progress("choosing a test that separates the rivals")
        next_test, why_none = _next_test(named, further)
        doubts += why_none
    asks = (
        verdicts.condition not in ("not_testable_here", "out_of_range")
        and verdicts.runs_to_decide is None
        and given is None
    )
    tests = naming_tests(further, result, verdicts.budget, named, (sound, elsewhere)) if asks else []
    place = JudgedPlace(verdicts.accuracy.place, fitted, elsewhere or judges or sound, stages, gaps.judged)
    diagnosis = replace(
        verdicts, calibrated=calibrated, remains=remains, staircase=staircase, next_test=next_test,
        doubts=tuple(doubts), only_commanded=any(run.has_only_commanded_angles for run in used),
    )  # fmt: skip
    acts = acts_of(diagnosis, place, tests, _before(used) if early else ())
    return replace(diagnosis, acts=acts, seconds=time.perf_counter() - begin_s)


def _found_in(
    runs: Sequence[ObservedRun], given: Sequence[Effect] | None, progress: Callable[[str], None]
) -> tuple[SearchResult, OutOfRange | None]:
    """Return the result of a search in runs, of (m, k) mm, or of the fit of `given` effects. If a search finds that one
    parameter is out of range, the result is the fit of that one, without a limit."""
    if given is not None:
        return fit_given(runs, given, progress), None
    result = search(runs, progress)
    beyond = find_out_of_range(result, runs)
    return (fit_given(runs, [beyond.effect], progress, frozenset({beyond.name})) if beyond else result), beyond


_TEMPERATURE = re.compile(r"(?<![a-z])temp(erature)?(?![a-z])")


def _temperature(used: Sequence[Measured]) -> Array | None:
    """Return the temperature (n,) of each table row; None for several runs or if unknown.

    It is an extra column identified by its name, in any unit.
    """
    table = used[0].run.table if len(used) == 1 else None
    if table is None:
        return None
    for name in table.column_names:
        if _TEMPERATURE.search(name.casefold()):
            try:
                values = np.array([float(str(cell).replace(",", ".")) for cell in table[name].to_pylist()])
            except ValueError:
                continue
            return values if len(values) == len(used[0].table.q) and np.isfinite(values).all() else None
    return None


def _before(used: Sequence[Measured]) -> tuple[Act, ...]:
    """Return the first action if joints were read too early, depending on the presence of commanded angles."""
    tables = [run.run.table for run in used if run.table.kind.of_tracker]
    commanded = any(table is not None and COMMANDED[0] in table.column_names for table in tables)
    return (EARLY_COMMANDED if commanded else EARLY,)


def _gaps(
    judged: Sequence[tuple[Sequence[ObservedRun], Sequence[str]]],
    stages: Stages,
    result: SearchResult,
    left_out: LeftOut | None,
) -> Gaps:
    """Return the gaps of the runs used, held out and elsewhere, each with their names; residuals are (m, k) mm."""
    (sound, used), *others = judged
    held_out, unseen = (gap(runs, stages, result, names) if runs else None for runs, names in others)
    are_places = left_out is not None and len(left_out.rows) == len(result.linear.y)
    return Gaps(
        gap(sound, stages, result, used), held_out, unseen, left_out.rms_um if left_out and are_places else None
    )


def _named_in(
    result: SearchResult,
    fitted: FittedRuns,
    runs: tuple[Sequence[ObservedRun], Sequence[ObservedRun]],
    changes: Sequence[EffectChange],
    train: Gap,
    *,
    given: bool,
) -> tuple[list[Named], tuple[str, ...]]:
    """Return the effects of a search as names, confirmed ones first, and doubts about their sizes.

    `runs`: used and held out, of (m, k) mm. Unless the effects were `given`, a vibration of the link is a name too.
    """
    used, judges = runs
    named = named_effects(result, fitted, held_out_gains(result, judges), changes)
    named = without_useless(named, train)
    doubts = doubts_of_limits(named)
    vibrations = [name for name in named if given and isinstance(name.effect, type(vibration_at(1.0, 0.0)))]
    swing = None
    if vibrations or not given:
        swing = find_vibration(with_effects(used, result.effects), result.linear.setups)
    if swing is not None and given:
        doubts += doubts_of_phases(vibrations, swing)
    elif swing is not None:  # confirmed if its contribution exceeds the scatter of a circle without it
        circles = [block.sampling is not None for block in result.linear.blocks]
        limits = limits_um(result.linear, swing.scatter_um)
        named += named_vibration(swing, limits[circles], train.after_um)
    named = [
        replace(name, alone_um=fitted.residual_um([name.effect])) if name.stands or given else name for name in named
    ]
    return sorted(named, key=lambda name: (not name.stands, -name.worth_um)), doubts


def _verdicts_of(
    rig: Rig,
    result: SearchResult,
    both: tuple[Gaps, Gaps],
    named: Sequence[Named],
    changes: Sequence[EffectChange],
    accuracy: Accuracy,
    *,
    early: bool,
) -> Diagnosis:
    """Return the verdicts, for readings (m, k): a diagnosis without calibrated model, next test, doubts and actions.

    `both`: gaps with the complete model, which decide the condition, and with the exported model. `early`: whether
    poses were read before standstill.
    """
    whole, gaps = both
    remainder, is_material = remainder_of(result, named, result.scatter_limits_um, gaps.train)
    named = within_unexplained(named, remainder.um if is_material else 0.0)
    named = sorted(named, key=lambda name: (not name.stands, -name.worth_um))
    condition = condition_of(result, named, remainder, whole, is_material=is_material, early=early)
    linear, measure = result.linear, Measure(result.linear)
    drawn = [linear.in_mm(measure.without_set_up(linear.residual(effects))) for effects in ((), result.effects)]
    is_testable = condition != "not_testable_here"
    return Diagnosis(
        condition=condition,
        accuracy=accuracy,
        budget=tuple(Budget(result, gaps.train).parts(named, changes)) if is_testable else (),
        runs_to_decide=runs_to_decide(result, named) if condition == "undecided" and needs_runs(named) else None,
        rig=rig,
        runs=gaps.train.runs,
        where=places(linear.blocks, drawn[0], measure.scatter_mm()),
        effects=tuple(named) if is_testable else (),
        remainder=remainder,
        train=gaps.train,
        held_out=gaps.held_out,
        unseen=gaps.unseen,
        left=bands_above_noise(linear.blocks, result.posterior.residual),
        setups=linear.setups,
        groups=tuple(
            (name_of(name.effect), *(name_of(rival.effect) for rival in name.rivals))
            for name in named
            if name.rivals and (name in ambiguous_names(named) or fault_rivals(name))
        ),
        not_testable=result.selection.not_testable(result.state, result.posterior),
        next_test=None,
        repeated=all(block.measured for block in linear.blocks),
        shows_noise=all(block.measured or shows_noise(block) for block in linear.blocks),
        level=result.state.level,
        doubts=(),
        curves=curves_of(linear.blocks, *drawn),
        maps=maps_of(linear.blocks, *drawn),
        seconds=0.0,
    )


def _completed(
    verdicts: Diagnosis, result: SearchResult, left_out: LeftOut | None, beyond: OutOfRange | None
) -> Diagnosis:
    """Return verdicts with what the unexplained part of the readings (N,) follows, if there is much of it. If it
    follows nothing and no target was visited twice, it is scatter; if a parameter is `beyond` its limit, that is the
    condition."""
    if beyond and verdicts.is_testable:
        verdicts = replace(verdicts, condition="out_of_range", runs_to_decide=None, groups=())
    if verdicts.condition != "outside_library":
        return replace(verdicts, unexplained=Unexplained(verdicts.remainder.um))
    unexplained = unexplained_of(result, left_out, verdicts.remainder.um)
    verdicts = replace(verdicts, unexplained=unexplained)
    return as_scatter(verdicts) if unexplained.scatter_um and not verdicts.standing else verdicts


def _hold_enough(runs: Sequence[ObservedRun]) -> None:
    """Raise FileError if there are fewer readings than set-up terms."""
    terms = sum({run.setup: run.table.kind.setup_terms for run in runs}.values())
    if (count := sum(run.values.size for run in runs)) < terms:
        raise FileError("RUN…", f"{count} readings are fewer than the {terms} terms of the set-up", "give more runs")


def _names(runs: Sequence[Measured]) -> list[str]:
    return [run.run.manifest.name for run in runs]


def _next_test(named: Sequence[Named], further: FurtherTests) -> tuple[NextTest | None, list[str]]:
    """Return the shortest test that, together with the existing runs, separates the first ambiguous name from its
    closest rival; otherwise a doubt."""
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
