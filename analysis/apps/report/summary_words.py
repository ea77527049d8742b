"""Summary of a diagnosis in a given language. Headline, figures, causes and next step are selected only here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from analysis.apps.report.act_words import ActWords, command, load_variant, without_idle_mounts
from analysis.apps.report.answer_words import (
    HARMLESS,
    AnswerWords,
    has_model,
    is_certain_except_small,
    is_complete,
    judged_gap,
    large_parts,
    part_of,
    unusual_groups,
)
from analysis.apps.report.diagnosis_words import error_size, has_measured_noise, measured_u, micrometres, size, sure
from analysis.apps.report.summary import WITHOUT_FAULT, BarSegment, ErrorChange, Summary, Tone, with_driven_error
from analysis.apps.report.texts import Texts, texts_of
from analysis.correction.deviation import Deviation
from analysis.diagnosis.judge.act_list import LEAST_SHARE
from analysis.diagnosis.judge.acts import IMITATED, Act, Doubt
from analysis.diagnosis.judge.result import CERTAIN_ODDS, LARGE_SHARE, BudgetPart, Diagnosis, Named, likely_rivals

_MOST_CAUSES = 3
"""Maximum number of bar segments with their own names. Chosen: as many names as fit on a phone."""
_MOST_RIVALS = 3
"""Maximum number of rivals in the headline. Chosen: as many as causes."""
_LEAST_SHARE = 0.01
"""Minimum share of the error for a main cause. Chosen: the narrowest visible segment."""
_TENTH_PERCENT = 0.001
_LIKELY = 0.5
"""Odds below which the likeliest member of a part is not named in the headline: another member is likelier."""
_IMITATED: tuple[Doubt, ...] = (*IMITATED, "small")
"""Doubts meaning that an effect may only imitate a different cause."""
_REPAIRS = ("repair", "remaster", "enter", "mount")
"""Kinds of acts that change the arm or its set-up, so that a correction from the same runs no longer fits."""
_UNDECIDED = ("out_of_range", "outside_library", "undecided", "not_testable_here")
"""Conditions under which no cause and no act is certain."""


def summarise(
    diagnosis: Diagnosis,
    texts: Texts | None = None,
    *,
    acts: Sequence[Act] | None = None,
    driven: tuple[Deviation, Deviation] | None = None,
    judged_elsewhere: tuple[float, float] | None = None,
) -> Summary:
    """Return the summary of a diagnosis.

    acts: the open acts, by default those of the diagnosis. driven: error measured before and after a correction.
    judged_elsewhere: see `AnswerWords`.
    """
    words = _SummaryWords(diagnosis, texts or texts_of("en"), judged_elsewhere)
    open_acts = without_idle_mounts(diagnosis.acts) if acts is None else acts
    act = open_acts[0] if open_acts else None
    summary = Summary(
        badge=words.badge,
        standing=words.badge_keys[0],
        tone=words.tone,
        headline=" ".join(words.first_sentences),
        unknowns=tuple(words.unknowns(act)),
        error=words.error,
        causes=tuple(words.causes),
        next=words.step(act) if act else "",
        command=command(act) if act else "",
    )
    return with_driven_error(summary, *driven, words.texts) if driven else summary


def _tenths_percent(share: float) -> str:
    return f"{100 * share:.1f} %"


@dataclass(frozen=True)
class _SummaryWords:
    """Sentences of a summary."""

    diagnosis: Diagnosis
    texts: Texts = field(default_factory=partial(texts_of, "en"))
    judged_elsewhere: tuple[float, float] | None = None

    @property
    def answer(self) -> AnswerWords:
        """The sentences of the diagnosis."""
        return AnswerWords(self.diagnosis, self.texts, self.judged_elsewhere)

    @property
    def badge(self) -> str:
        """The condition of the arm in a word or two, after a contradicted constant or a movement."""
        return ", ".join(self.texts(f"badge_{key}") for key in self.badge_keys)

    @property
    def badge_keys(self) -> list[str]:
        """The parts of the badge."""
        diagnosis = self.diagnosis
        keys = ["contradicted"] * bool(diagnosis.contradictions) + ["moved"] * bool(diagnosis.movements)
        if not keys or (not diagnosis.contradictions and diagnosis.condition not in HARMLESS):
            # Plain scatter hides every other error, so that nothing is shown to be usual.
            is_hidden = diagnosis.unexplained is not None and diagnosis.unexplained.scatter_um is not None
            is_larger = any(part.share > LEAST_SHARE for part in unusual_groups(diagnosis))
            condition = "no_certain_fault" if is_certain_except_small(diagnosis) else diagnosis.condition
            keys.append("undecided" if is_hidden else "unusual_group" if is_larger else condition)
        # Without a fault the badge alone would look like a pass, and with a fault like a fail.
        is_shown = keys[0] in WITHOUT_FAULT and diagnosis.accuracy.standing in ("watch", "fail")
        if is_shown or self._is_within_limits:
            keys.append(f"limits_{diagnosis.accuracy.standing}{'_uncorrected' * has_model(diagnosis)}")
        return keys

    @property
    def _is_within_limits(self) -> bool:
        """Whether faults are the main finding although the error is within the limits."""
        diagnosis = self.diagnosis
        is_main = not (diagnosis.contradictions or diagnosis.movements)
        return is_main and diagnosis.condition in ("named", "ambiguous") and diagnosis.accuracy.standing == "pass"

    @property
    def tone(self) -> Tone:
        """The colour of the badge: that of the accuracy if no fault was found."""
        first, *others = self.badge_keys
        if first in WITHOUT_FAULT and any("fail" in key for key in others):
            return "fail"
        if first in HARMLESS and not others:
            return "pass"
        return "unjudged" if first in ("undecided", "no_certain_fault", "not_testable_here") else "watch"

    @property
    def first_sentences(self) -> list[str]:
        """Sentences that limit the conclusions, then the cause, small undecided parts and the unexplained error.

        The cause is omitted if the readings contradict a stated constant, because the constant must be checked first.
        """
        remark = self.texts("fault_within_limits") if self._is_within_limits else ""
        undecided = self.answer.usual_or_faults if is_certain_except_small(self.diagnosis) else ""
        causes = [self._cause, *filter(None, [remark, undecided, self.answer.unexplained_too])]
        return [*self.answer.preconditions, *([] if self.diagnosis.contradictions else causes)]

    @property
    def _cause(self) -> str:
        """Headline of the cause, with a capital letter."""
        headline = self._lower_case_cause()
        return f"{headline[:1].upper()}{headline[1:]}"

    def _lower_case_cause(self) -> str:
        """Return the largest cause with size and certainty, and the largest fault if it is a different cause.

        If no cause is certain, return the condition.
        """
        names_open = any(named.doubt == "commanded" for named in self.diagnosis.effects)
        if self.diagnosis.condition in ("out_of_range", "outside_library") or names_open:
            return self.answer.condition_sentence
        leading = self._leading()
        is_minor = any(is_fault for _, is_fault in leading) or is_certain_except_small(self.diagnosis)
        if (undecided := self.answer.usual_or_faults) and not is_minor:
            return undecided
        if leading:
            (first, is_fault), *others = leading
            if not is_fault and (faults := [phrase for phrase, of_fault in others if of_fault]):
                others = others[1:]
                first = self.texts("also_a_fault", first=first, fault=faults[0])
            ending = f", {self.texts('and_more', count=len(others))}" if others else ""
            return f"{first}{ending}."
        return self.answer.condition_sentence

    def _leading(self) -> list[tuple[str, bool]]:
        """Return faults and other large parts of the error as phrases, largest first, each with a flag for a fault."""
        faults = [(part_of(self.diagnosis, named), named) for named in self.diagnosis.standing]
        phrases = [(part.share if part else 0.0, self._effect(named, part), True) for part, named in faults]
        phrases += [(part.share, self._part(part), False) for part in large_parts(self.diagnosis)]
        imitated = [part for part in self.diagnosis.budget if part.share > LARGE_SHARE and self._may_be_imitated(part)]
        phrases += [(part.share, self._cause_name(part), False) for part in imitated]
        return [(phrase, is_fault) for _, phrase, is_fault in sorted(phrases, key=lambda entry: -entry[0])]

    def _part(self, part: BudgetPart) -> str:
        if part.index is not None:
            return self._effect(self.diagnosis.effects[part.index], part)
        name = self.answer.short_name(part)
        if not part.members:
            return name
        member = part.members[0]
        if member.odds < _LIKELY:
            return self.texts("no_single_member", part=name)
        return self.texts("probable_member", part=name, member=self.answer.noun(member.effect), odds=sure(member.odds))

    def _effect(self, named: Named, part: BudgetPart | None) -> str:
        """Return an effect with size and certainty, a remark if the size is usual, and the likely rivals.

        If the effect is not likely by itself, return only the causes with their odds.
        """
        if named.probability < _LIKELY and likely_rivals(named):
            causes = self.answer.likeliest_first(named)[: _MOST_RIVALS + 1]
            odds = [f"{self.answer.noun(cause.effect)} ({sure(cause.probability)})" for cause in causes]
            return self.texts("one_of", causes=self.texts("or").join(odds))
        is_certain = named.probability >= CERTAIN_ODDS
        certainty = self.texts("certain") if is_certain else self.texts("likely", odds=sure(named.probability))
        certainty = "" if is_certain and named.twins else certainty  # of the group, not of its first member
        usual = self.texts(f"size_{part.rank}") if part and part.rank in ("usual", "difference") else ""
        first = ", ".join(filter(None, [self.answer.noun(named.effect), size(named), certainty, usual]))
        others_too = (*named.twins, *(rival.effect for rival in likely_rivals(named)))
        rivals = list(dict.fromkeys(map(self.answer.noun, others_too)))
        unnamed = [self.texts("and_more", count=len(rivals) - _MOST_RIVALS)] if len(rivals) > _MOST_RIVALS else []
        others = ", ".join([self.texts("or").join(rivals[:_MOST_RIVALS]), *unnamed])
        return self.texts("otherwise", first=first, others=others) if rivals else first

    def unknowns(self, act: Act | None) -> list[str]:
        """Return the limits of the evidence as sentences, except those in the headline."""
        diagnosis, texts = self.diagnosis, self.texts
        sentences = [self._cause] if diagnosis.contradictions else []
        sentences.append(self.answer.visits)
        is_open = diagnosis.condition in _UNDECIDED and not self.answer.usual_or_faults
        if is_open and (sentence := self.answer.condition_sentence) != self._cause:
            sentences.append(sentence)
        sentences.append(self.answer.follows)
        if act and (against := ActWords(diagnosis, texts).against(self._beyond_basis(act))):
            sentences.append(texts("uncertain", against=against))
        return list(filter(None, sentences))

    def _beyond_basis(self, act: Act) -> Act:
        """Return an act without the objection that the tile of the error already states."""
        return replace(
            act, against=tuple(objection for objection in act.against if objection.why != "not_judged_elsewhere")
        )

    def step(self, act: Act) -> str:
        """Return the next step, marked as unnecessary if it only improves an arm within its limits."""
        step = step_of(act, self.diagnosis, self.texts)
        is_optional = self._is_within_limits and act.kind in ("load", "approach", *_REPAIRS)
        return self.texts("optional_step", step=step) if is_optional else step

    @property
    def error(self) -> ErrorChange:
        """The error now and after repair and correction, both on the runs used to validate the model.

        An assumed noise is no measured uncertainty of the two figures, and the basis says so.
        """
        return self._error_change.with_remarks(self.texts, is_measured=has_measured_noise(self.diagnosis))

    @property
    def _error_change(self) -> ErrorChange:
        """The error now and after, each with the uncertainty of the measured noise of its runs."""
        diagnosis, texts, accuracy = self.diagnosis, self.texts, self.diagnosis.accuracy
        place: str = accuracy.place
        before_um, after_um = accuracy.before_there_um, accuracy.calibrated_um
        gap = judged_gap(diagnosis)
        label = "error_left_by_model" if has_model(diagnosis) else "error_now_label"
        change = ErrorChange(texts(label), "", texts("error_after_label"), "", "", self.answer.judged)
        if place == "used" and self.judged_elsewhere:
            before_um, after_um = self.judged_elsewhere
            after = error_size(after_um, 0.0)
            return replace(change, now=error_size(before_um, 0.0), after=after, basis=texts("basis_unseen"))
        now = self._error(before_um, gap.u_um)
        if not diagnosis.is_testable:
            return replace(change, now=now, basis=texts("basis_unknown"))
        if is_complete(diagnosis) and place == "used":
            return replace(change, now=now, basis=texts("basis_now"))
        if diagnosis.condition == "out_of_range":
            after = self._error(diagnosis.train.after_um, diagnosis.train.left_u_um)
            now = self._error(accuracy.now_um, diagnosis.train.u_um)
            return replace(change, now=now, after=after, basis=texts("basis_out_of_range"))
        crossed = diagnosis.remains if place == "used" else None
        basis = texts("basis_crossed", um=micrometres(crossed.um)) if crossed else texts(f"basis_{place}")
        basis = " ".join(filter(None, [basis, self._each_by_itself]))
        return replace(change, now=now, after=self._error(after_um, gap.left_u_um), basis=basis)

    def _error(self, um: float, u_um: float) -> str:
        return error_size(um, measured_u(self.diagnosis, u_um))

    @property
    def _each_by_itself(self) -> str:
        """The errors after only the correction and only the repairs, and the order; empty unless both exist."""
        acts = [act for act in self.diagnosis.acts if act.removes and act.place == self.diagnosis.accuracy.place]
        corrections, repairs = ([act for act in acts if act.kind in kinds] for kinds in (("load",), _REPAIRS))
        if not corrections or not repairs:
            return ""
        after_all_um = repairs[-1].with_before_um  # None for a single repair
        repaired = micrometres(repairs[-1].residual_um if after_all_um is None else after_all_um)
        return self.texts("each_by_itself", corrected=micrometres(corrections[0].residual_um), repaired=repaired)

    @property
    def causes(self) -> list[BarSegment]:
        """The largest parts of the error as separate segments, and all other parts as a single segment."""
        parts = [part for part in self.diagnosis.budget[:_MOST_CAUSES] if part.share >= _LEAST_SHARE]
        causes = [
            BarSegment(self._cause_name(part), min(part.share, 1.0), _tenths_percent(part.share), part.rank or "")
            for part in parts
        ]
        rest = 1.0 - sum(cause.share for cause in causes)
        if causes and rest >= _TENTH_PERCENT:
            causes.append(BarSegment(self.texts("other_causes"), rest, _tenths_percent(rest)))
        return causes

    def _may_be_imitated(self, part: BudgetPart) -> bool:
        return part.index is not None and self.diagnosis.effects[part.index].doubt in _IMITATED

    def _cause_name(self, part: BudgetPart) -> str:
        """Return the name of a part, marked if an unknown cause may imitate it. An uncertain effect has its
        probability, as in the headline.
        """
        name = self.answer.short_name(part)
        named = self.diagnosis.effects[part.index] if part.index is not None else None
        if self._may_be_imitated(part):
            return f"{name} ({self.texts('not_confirmed')})"
        if named is not None and named.probability < _LIKELY and likely_rivals(named):
            return self.answer.with_rivals(named)
        is_open = named is not None and named.probability < CERTAIN_ODDS
        return f"{name} ({self.texts('likely', odds=sure(named.probability))})" if named and is_open else name


def step_of(act: Act, diagnosis: Diagnosis, texts: Texts) -> str:
    """Return an act as an imperative sentence, excluding its command line."""
    if act.kind == "load":
        return texts(f"do_load{load_variant(diagnosis.rig)}")
    return texts("do_convert") if act.kind == "convert" else ActWords(diagnosis, texts).what(act)
