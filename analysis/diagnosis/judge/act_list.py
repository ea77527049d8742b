"""List of actions from a diagnosis, each evaluated by the remaining error at a validation place.

The reduction by an action is computed by applying it to the model and refitting the set-ups, as for the gap, so
contributions of other parts are not counted. The error of the complete model at the validation place is included in the
uncertainty of each figure.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from analysis.diagnosis.evidence.observation import ObservedRun
from analysis.diagnosis.evidence.setups import FittedRuns
from analysis.diagnosis.evidence.significance import SURE_SIGMA
from analysis.diagnosis.fit.selection_state import LEAST_SHARE
from analysis.diagnosis.judge.acts import (
    CHANGES_ARM,
    CORRECTED,
    FOUND,
    Act,
    ActiveCorrection,
    Against,
    Cost,
    JudgedOn,
    NamingTest,
    Reason,
    open_acts,
)
from analysis.diagnosis.judge.budget_part import LARGE_SHARE, BudgetPart
from analysis.diagnosis.judge.certainty import fault_rivals, has_certain_name, is_certain_cause, is_open, likely_rivals
from analysis.diagnosis.judge.named import Named
from analysis.diagnosis.judge.residuals import independent_um
from analysis.diagnosis.judge.result import Diagnosis, Gap
from rigs.calibration import verdict_of
from rigs.effects import Effect, turned
from rigs.schema.effect import label_of, name_of, size_field
from rigs.schema.scene import OUTSIDE_ARM

_WORTH = 0.8
"""Largest remaining share of the error for a worthwhile correction. Chosen: a reduction by a fifth."""
_REPEATS = 2
"""Runs per direction needed to show changes with time."""
_WRONG = 25.0
"""Ratio to the usual size above which a constant of the arm is checked in the rig file before it is corrected: 5 mm of
an industrial, 10 mm of a light arm. Chosen: the nominal constants of the right arm are accurate to 10 mm. A softness
or a gear error is no constant of the rig file.
"""


@dataclass(frozen=True)
class JudgedPlace:
    """Place at which the actions are evaluated."""

    place: JudgedOn
    used: FittedRuns
    """The runs used, whose set-ups apply to all runs of the same placement."""
    there: Sequence[ObservedRun]
    """Validation runs."""
    calibrated: Sequence[Effect]
    """Effects of the calibrated model."""
    gap: Gap
    predicted_um: float | None = None
    """Error at poses used, each predicted by the others, ± `predicted_u_um`."""
    predicted_u_um: float = 0.0
    is_validated: bool = False
    """True if these poses are enough to validate the model."""

    def removed(self, effects: Sequence[Effect], relative_u: float = 0.0) -> Act:
        """Figures of an action that removes these effects. relative_u: relative uncertainty of the change."""
        before = self.gap.before_um
        after = self.used.residual_um(effects, self.there)
        change = math.sqrt(max(abs(before**2 - after**2), 0.0))
        u_um = math.hypot(relative_u * change, self.gap.residual_u_um)
        return Act(
            "none", "sound", removes_um=before - after, removes_u_um=u_um, place=self.place, remains_um=after,
            remains_u_um=u_um,
        )  # fmt: skip


EARLY_COMMANDED = Act("convert", "early", command=("import", "TABLE", "--test", "pose", "--joints", "commanded"))
MOVED = Act("mount", "moved")
"""First action after a movement between or within the runs."""
CHECK_STATED = Act("check", "contradicted")
"""First action if the readings contradict a stated constant: remeasure the constant."""
CHECK_CONSTANTS = Act("check", "other_robot")
"""Only action if the constants of the controller may be those of another robot: every other depends on them."""
EARLY = Act("wait", "early")
"""First action if joints were read before standstill: use the commanded angles of the file if present, or repeat the
measurement."""


def acts_of(
    diagnosis: Diagnosis,
    judged: JudgedPlace,
    tests: Sequence[tuple[int, NamingTest, Cost]] = (),
    before: Sequence[Act] = (),
) -> tuple[Act, ...]:
    """List the actions in order of their reduction.

    tests: tests that would identify a part of the budget, by index. before: actions required by the readings
    themselves.
    """
    if diagnosis.given:
        return ()
    if diagnosis.condition == "not_testable_here":
        return (*before, Act("measure", "not_visible", command=("plan", _model(diagnosis))))
    if diagnosis.condition == "out_of_range":
        return (*before, _check(diagnosis, judged))
    repairs = _repairs(diagnosis, judged)
    if diagnosis.condition == "nothing_unusual" and diagnosis.accuracy.standing == "pass" and not repairs:
        # Within the limits, a correction or a one-sided approach would change programs needlessly.
        large = diagnosis.parts(lambda part: part.share > LEAST_SHARE)
        return (*before, Act("none", "sound", parts=large), *_measurements(diagnosis, judged, tests))
    reducing = [*repairs, *_corrections(diagnosis, judged), *_approaches(diagnosis, judged)]
    reducing = _parameters_first(in_order(reducing, diagnosis.train.before_um), diagnosis)
    # An action on a cause that is not certain follows the measurements, because one of them may confirm it.
    reducing = one_after_the_other(sorted(reducing, key=lambda act: act.conditional), judged)
    certain, conditional = _divided(reducing, lambda act: not act.conditional)
    asked = _measurements(diagnosis, judged, tests)
    first, later = _divided(asked, lambda act: _comes_first(act, reducing, diagnosis, judged))
    # A test that shows whether the correction holds elsewhere precedes the correction.
    before_load, later = _divided(later, lambda act: act.why == "elsewhere" and not judged.is_validated)
    load = next((k for k, act in enumerate(certain) if act.kind == "load"), len(certain))
    acts = [*first, *certain[:load], *before_load, *certain[load:], *later, *conditional]
    served = {k for act in acts for k in act.parts}
    acts += [
        Act("none", _reason(diagnosis, part), parts=(k,), remains_um=part.um, remains_u_um=part.u_um)
        for k, part in enumerate(diagnosis.budget)
        if part.share > LEAST_SHARE and k not in served
    ]
    acts = _with_active_correction(acts) if diagnosis.driven_corrected else acts
    return (*before, *(acts or [Act("none", "sound")]))


def _divided(acts: Sequence[Act], is_first: Callable[[Act], bool]) -> tuple[list[Act], list[Act]]:
    return [act for act in acts if is_first(act)], [act for act in acts if not is_first(act)]


def _with_active_correction(acts: Sequence[Act]) -> list[Act]:
    """Actions for a robot that drives corrected programs: nothing first, unless manual actions leave a smaller error
    than the correction. The others would replace the correction, and come last.
    """
    loads = next((act for act in acts if act.kind == "load"), None)
    if loads is None:
        return list(acts)
    active = ActiveCorrection("programs", loads.residual_um, loads.remains_u_um or 0.0)
    to_do, instead = open_acts(acts, active, elsewhere=False)
    replaced = [replace(act, against=(*act.against, Against("corrected"))) for act in instead]
    if any(act.kind in CHANGES_ARM and act.remains_um is not None and not act.conditional for act in to_do):
        return [*to_do, *replaced]
    corrected = replace(CORRECTED, parts=loads.parts, place=loads.place, remains_um=loads.remains_um)
    return [replace(corrected, remains_u_um=loads.remains_u_um), *to_do, *replaced]


def _check(diagnosis: Diagnosis, judged: JudgedPlace) -> Act:
    """A parameter that is out of range must not be corrected: check the origin of the difference."""
    (named,) = diagnosis.effects
    parts = diagnosis.parts(lambda part: part.index == 0)
    figures = judged.removed([named.effect])
    u = named.sd.get(size_field(named.effect))
    return replace(figures, kind="check", why="out_of_range", parts=parts, effect=named.effect, u=u)


def in_order(acts: Sequence[Act], now_um: float) -> list[Act]:
    """Sort actions by their reduction, and a one-sided approach of unknown gain by the error of the part.

    Usual effects are corrected first and repaired if this is not sufficient: the repair follows the correction.
    """
    corrected = {k for act in acts if act.kind in ("load", "approach") for k in act.parts}
    load_um = max((act.gain_um for act in acts if act.kind == "load"), default=math.inf)
    late = [act for act in acts if act.why == "sure_and_large" and act.kind == "repair" and {*act.parts} <= corrected]
    late.sort(key=lambda act: -act.gain_um)
    ordered: list[Act] = []

    def weight_um(act: Act) -> float:
        is_unknown = act.kind == "approach" and act.removes_um is None
        um = now_um - independent_um(now_um, act.residual_um) if is_unknown else act.gain_um
        # A correction precedes manual actions of about the same gain, whatever the noise adds to either.
        return min(um, load_um) if act.kind not in ("load", "approach") and um < load_um + LEAST_SHARE * now_um else um

    by_weight = sorted(acts, key=lambda act: (-weight_um(act), act.kind != "load"))
    for act in [act for act in by_weight if act not in late]:
        ordered.append(act)
        served = {part for done in ordered if done.kind in ("load", "approach") for part in done.parts}
        behind = [repair for repair in late if {*repair.parts} <= served]
        ordered += [replace(repair, why="not_enough") for repair in behind]
        late = [repair for repair in late if repair not in behind]
    return ordered


def _parameters_first(acts: Sequence[Act], diagnosis: Diagnosis) -> list[Act]:
    """Put checks of large faults first, because a correction or repair would hide a wrong parameter."""

    def is_first(act: Act) -> bool:
        return act.kind == "check" and any(diagnosis.budget[k].share > LEAST_SHARE for k in act.parts)

    return sorted(acts, key=lambda act: not is_first(act))


def one_after_the_other(acts: Sequence[Act], judged: JudgedPlace) -> list[Act]:
    """Add to each manual action the error that remains after it and all preceding manual actions."""
    done: list[Effect] = []
    square_um2, ordered = 0.0, []
    for act in acts:
        by_hand = act.effect if act.kind != "approach" else None
        if by_hand is not None:
            done.append(by_hand)
            square_um2 += (act.removes_u_um or 0.0) ** 2
        is_later = by_hand is not None and len(done) > 1
        um = judged.removed(done).remains_um if is_later else None
        ordered.append(replace(act, with_before_um=um, with_before_u_um=math.sqrt(square_um2) if is_later else None))
    return ordered


def _approaches(diagnosis: Diagnosis, judged: JudgedPlace) -> list[Act]:
    """A one-sided approach to every target, the interim action for direction-dependent effects, which targets cannot
    represent.

    The gain is that of the worse side, because both sides are equally likely to be chosen.
    """
    acts = []
    for k, part in enumerate(diagnosis.budget):
        named = diagnosis.named_of(part)
        if named is None or part.share <= LEAST_SHARE or not has_certain_name(diagnosis, part):
            continue
        effect = named.effect
        if effect.part == "reversal" and effect.compensation().use == "none":
            flank = effect.flank_deg()
            flanks = [turned(int(getattr(effect, "axis", 1)), side * flank) for side in (1, -1)] if flank else []
            sides = [judged.removed([effect, constant], part.u_um / part.um) for constant in flanks]
            unknown = Act("approach", "history", remains_um=part.um, remains_u_um=part.u_um)
            figures = min(sides, key=lambda act: act.gain_um, default=unknown)
            against = tuple(_of_the_place(diagnosis, judged))
            if figures.removes or not sides:
                acts.append(
                    replace(figures, kind="approach", why="history", parts=(k,), effect=effect, against=against)
                )
    return acts


def _repairs(diagnosis: Diagnosis, judged: JudgedPlace) -> list[Act]:
    """Manual actions for faults and for usual effects that cause much of the error.

    If errors cancel, removing a fault alone may increase the error.
    """
    served = [(k, named) for k, part in enumerate(diagnosis.budget) for named in _by_hand(diagnosis, part)]
    acts = [_repair(diagnosis, judged, k, named) for k, named in served]
    # A controller with unknown constants may already contain a usual difference.
    not_offered = ("enter", "remaster") if diagnosis.rig.controller == "unknown" else ()
    return [act for act in acts if act.why == "fault" or (act.gain_um > 0 and act.kind not in not_offered)]


def _by_hand(diagnosis: Diagnosis, part: BudgetPart) -> list[Named]:
    """Effects of a part that need a manual action: its own effect, and faults that cancel some of it.

    A certain effect of usual size causing much of the error is entered or re-mastered. It is repaired if few arms reach
    that size, or if the arm exceeds the limits.
    """
    named = diagnosis.named_of(part)
    of_part = [named] if named else []
    rare = (part.times_usual or 0.0) >= SURE_SIGMA or diagnosis.accuracy.standing in ("watch", "fail")
    is_much = part.share > LARGE_SHARE and has_certain_name(diagnosis, part)
    if cause := part.cause:  # the only certain member of a group, as an effect of usual size
        effect, remedy = cause.effect, cause.effect.remedy()
        of_part = [Named(effect, cause.sd, cause.odds, (), math.nan, remedy, cause.um, None, "usual", u_um=cause.u_um)]
    own = [
        name
        for name in of_part
        if name.is_confirmed or (is_much and (rare or name.effect.DEED in ("remaster", "enter", "check")))
    ]
    cancelling = [
        name for name in diagnosis.standing if name not in of_part and label_of(name.effect) in part.cancelled
    ]
    return [name for name in [*own, *cancelling] if name.shown]


def _repair(diagnosis: Diagnosis, judged: JudgedPlace, k: int, named: Named) -> Act:
    """Manual action for `named`: the effect of part k, or a fault that cancels a share of it."""
    part = diagnosis.budget[k]
    u_um, um = (part.u_um, part.um) if diagnosis.named_of(part) is named else (named.u_um, named.contribution_um)
    figures = judged.removed([named.effect], u_um / um if um > 0 else 1.0)
    is_constant = named.effect.compensation().use == "link constant"
    is_shown = named.is_confirmed or part.rank == "difference"
    is_wrong = is_constant and is_shown and (named.times_usual or 0.0) >= _WRONG
    rivals = tuple(name_of(rival.effect) for rival in likely_rivals(named))
    against = [Against("rivals", names=rivals)] if rivals else []
    if named.doubt is not None and named.doubt != "usual":
        against.append(Against("doubt", doubt=named.doubt))
    return replace(
        figures,
        kind="check" if is_wrong else named.effect.DEED,
        why="fault" if named.is_confirmed else "sure_and_large",
        parts=(k,),
        effect=named.effect,
        u=named.sd.get(size_field(named.effect)),
        against=(*against, *_of_the_place(diagnosis, judged)),
        conditional=not is_certain_cause(diagnosis, named),
    )


def _of_the_place(diagnosis: Diagnosis, judged: JudgedPlace) -> list[Against]:
    """Objections to all figures of the validation place."""
    against = [Against("doubt", doubt="commanded")] if diagnosis.only_commanded else []
    against += [Against("not_judged_elsewhere")] if judged.place == "used" else []
    if diagnosis.runs_to_decide is not None:
        against.append(Against("few_runs", runs=diagnosis.runs_to_decide))
    if diagnosis.condition == "outside_library":
        against.append(Against("unexplained"))
    return against


def _corrections(diagnosis: Diagnosis, judged: JudgedPlace) -> list[Act]:
    """The interim correction, programs and entries with all effects of the arm in the model, if its gain is certain and
    worthwhile.
    """
    if diagnosis.calibrated is None or verdict_of(diagnosis.calibrated) == "nothing":
        return []
    if _may_not_have_arrived(diagnosis):  # a correction would hide it
        return []
    effects = [effect for effect in judged.calibrated if effect.compensation().use != "none"]
    if not effects:
        return []
    figures = judged.removed(effects)
    before_um, fails = figures.gain_um + figures.residual_um, diagnosis.accuracy.standing in ("watch", "fail")
    left_um, u_um = judged.predicted_um, judged.predicted_u_um
    if judged.place == "used" and left_um is not None and left_um > figures.residual_um:
        # Readings left out of the fit show the error of a model of few poses, those used do not.
        figures = replace(
            figures, removes_um=before_um - left_um, removes_u_um=u_um, remains_um=left_um, remains_u_um=u_um
        )
    if not figures.removes or figures.residual_um >= (1.0 if fails else _WORTH) * before_um:
        return []

    def is_corrected(part: BudgetPart) -> bool:
        named = diagnosis.named_of(part)
        return named.effect.compensation().use != "none" if named else part.kind in ("constants", "gravity", "curve")

    parts = diagnosis.parts(is_corrected)
    command, against = ("correct", _model(diagnosis), "-o", "CORRECTIONS"), tuple(_of_the_place(diagnosis, judged))
    return [
        replace(
            figures, kind="load", why="correction", parts=parts, cost=Cost(minutes=0.0), command=command,
            against=against,
        )
    ]  # fmt: skip


def _model(diagnosis: Diagnosis) -> str:
    return f"{FOUND}{diagnosis.rig.name}.yaml"


def _measurements(
    diagnosis: Diagnosis, judged: JudgedPlace, tests: Sequence[tuple[int, NamingTest, Cost]]
) -> list[Act]:
    """Measurements that separate rivals, identify a group, decide, or validate elsewhere."""
    acts = []
    if _may_not_have_arrived(diagnosis):
        acts.append(Act("measure", "commanded", parts=diagnosis.parts(lambda part: part.share > LEAST_SHARE)))
    scatter = diagnosis.parts(lambda part: part.kind == "scatter")
    acts += [Act("measure", why, parts=scatter) for why in _reasons_to_repeat(diagnosis, scatter)]
    slow = [named for named in diagnosis.effects if named.doubt == "one_lap"]
    if slow:
        labels = {label_of(named.effect) for named in slow}
        parts = diagnosis.parts(lambda part: bool(labels & {part.name, *part.cancelled}))
        largest = max(slow, key=lambda named: named.contribution_um)
        um, effect = largest.contribution_um, largest.effect
        acts.append(Act("measure", "one_lap", parts=parts, remains_um=um, effect=effect, runs=_REPEATS))
    elif diagnosis.runs_to_decide is not None:
        parts = diagnosis.parts(lambda part: part.rank == "undecided" and part.index is not None)
        acts.append(Act("measure", "few_runs", parts=parts, runs=diagnosis.runs_to_decide))
    planned = {k: (test, cost) for k, test, cost in reversed(tests)}

    def test_of(why: Reason, k: int) -> Act:
        test, cost = planned.get(k, (None, Cost()))
        against = () if k in planned else (Against("no_place"),)
        return Act("measure", why, parts=(k,), test=test, cost=cost, against=against)

    fitted = {k: named for k, part in enumerate(diagnosis.budget) if (named := diagnosis.named_of(part))}
    for k, named in fitted.items():
        if (named.is_confirmed and likely_rivals(named)) or fault_rivals(named):
            acts.append(test_of("rivals", k))
    for k, part in enumerate(diagnosis.budget):
        if (part.members and not part.cause) or (k in fitted and is_open(part, fitted[k])):
            acts.append(test_of("group", k))
    if diagnosis.condition == "outside_library":
        parts = diagnosis.parts(lambda part: part.kind == "unexplained")
        if diagnosis.residual.likeliest:
            acts.append(Act("measure", "follows", parts=parts, place=judged.place))
        acts.append(Act("mount", "unexplained", parts=parts, place=judged.place))
    if judged.place == "used":
        acts.append(Act("measure", "elsewhere", place="used"))
    return acts


def _may_not_have_arrived(diagnosis: Diagnosis) -> bool:
    """True if a would-be fault may be an angle that the arm was commanded to and did not reach."""
    return any(named.doubt == "commanded" for named in diagnosis.effects)


def _reasons_to_repeat(diagnosis: Diagnosis, scatter: tuple[int, ...]) -> list[Reason]:
    """The reason to repeat measurements, if any. scatter: the parts of the budget that are scatter.

    Places visited once that scatter much, or more than usual, may have an error that every visit repeats.
    """
    residual = diagnosis.residual
    is_unusual = (residual.scatter_um or residual.unrepeated_um) is not None
    is_large = diagnosis.train.of_places and any(diagnosis.budget[k].share > LEAST_SHARE for k in scatter)
    if is_unusual or (is_large and not diagnosis.repeated):
        return ["revisit"]
    if residual.visits_um:
        return ["visits_differ"]
    return ["gauges_differ"] if residual.gauges_um else []


def _comes_first(measurement: Act, acts: Sequence[Act], diagnosis: Diagnosis, judged: JudgedPlace) -> bool:
    """True if a measurement precedes all actions that reduce the error, because it can still change the first of them:
    the gain of that action is not proven, or the error that the measurement concerns exceeds any proven gain.
    """
    if measurement.why == "commanded":
        return True
    proven = [act for act in acts if _is_proven(act, diagnosis, judged)]
    is_open = not acts or acts[0] not in proven
    loads = any(act.kind == "load" for act in acts)
    differ_um = {
        "visits_differ": diagnosis.residual.visits_um,
        "gauges_differ": diagnosis.residual.gauges_um,
        "one_lap": measurement.remains_um,
    }.get(measurement.why)
    if differ_um is not None:
        return not any(act.gain_um > differ_um for act in proven)
    share = sum(diagnosis.budget[k].share for k in measurement.parts)
    is_small = bool(measurement.parts) and share <= LEAST_SHARE
    first: dict[Reason, bool] = {
        "revisit": not proven,
        "few_runs": not proven and not is_small,
        "unexplained": not proven and not loads,
        "follows": not proven and not loads,
        "elsewhere": is_open and loads,
        "rivals": is_open and (diagnosis.condition == "undecided" or not acts or acts[0].parts == measurement.parts),
        "group": not acts,
    }
    return first.get(measurement.why, False)


def _is_proven(act: Act, diagnosis: Diagnosis, judged: JudgedPlace) -> bool:
    """True if readings with no part in the fit show the gain of an action, or a certain fault of the arm does.

    A fault is certain only if no rival is likely and no error of an unknown cause may imitate it.
    """
    if any(remark.why == "rivals" for remark in act.against):
        return False
    faults = [named.effect for named in diagnosis.standing if named.effect.part not in ("gauges", "clocks")]
    is_fault = diagnosis.condition == "named" and act.gain_um > 0 and act.effect in faults
    is_independent = judged.place != "used" or judged.is_validated
    return is_fault or (act.removes and is_independent)


def _reason(diagnosis: Diagnosis, part: BudgetPart) -> Reason:
    """Why a part above a tenth of the error has no action."""
    if part.kind == "scatter":
        return "scatter"
    if part.kind == "unexplained":
        return "unexplained"
    if part.kind in ("gauges", "clocks"):
        return "too_small" if part.rank == "undecided" else "gauges"
    named = diagnosis.named_of(part)
    if named and named.effect.compensation().use == "none":
        return "gauges" if named.effect.STAGE in OUTSIDE_ARM else "history"
    return "history" if part.kind in ("reversal", "warming") else "too_small"
