"""Summary of a diagnosis in three tiles, for page, window, terminal and picture: error, main causes, next step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from analysis.apps.report.act_words import REPAIRS, ActWords, without_idle_mounts
from analysis.apps.report.answer_words import (
    HARMLESS,
    LIKELY,
    has_model,
    is_certain_except_small,
    is_complete,
    is_mostly_scatter,
    judged_gap,
    large_parts,
    part_of,
    unusual_groups,
)
from analysis.apps.report.blocks import BadgeTone, BarSegment
from analysis.apps.report.diagnosis_words import (
    error_size,
    has_measured_noise,
    measured_u,
    micrometres,
    percent,
    sure,
)
from analysis.apps.report.texts import ENGLISH, Phrase, Texts, capital, extended, joined, keys_of
from analysis.correction.deviation import Deviation
from analysis.diagnosis.evidence.significance import SURE_SIGMA
from analysis.diagnosis.fit.selection_state import LEAST_SHARE
from analysis.diagnosis.judge.acts import IMITATED, Act
from analysis.diagnosis.judge.budget_part import LARGE_SHARE, BudgetPart
from analysis.diagnosis.judge.certainty import (
    has_certain_contribution,
    has_certain_name,
    is_certain_cause,
    likely_rivals,
    outweighs_unexplained,
)
from analysis.diagnosis.judge.named import Named
from analysis.diagnosis.judge.probability import CONFIRMED
from analysis.diagnosis.judge.result import Diagnosis
from rigs.schema.effect import is_wave, size_field


@dataclass(frozen=True)
class ErrorChange:
    now_label: str
    now: str
    after_label: str
    after: str
    basis: str
    standing: str = ""

    @property
    def words(self) -> str:
        return f"{self.now} → {self.after} µm rms" if self.after else f"{self.now} µm rms"

    @property
    def title(self) -> str:
        label = f"{self.now_label} → {self.after_label}" if self.after else self.now_label
        return label[:1].upper() + label[1:]

    def with_remarks(self, texts: Texts, *, is_measured: bool) -> ErrorChange:
        remarks = ["noise_assumed"] * (not is_measured) + ["error_bounded"] * ("<" in self.words)
        return replace(self, basis=joined([self.basis, *map(texts, remarks)]))


@dataclass(frozen=True)
class Summary:
    """standing: condition of the badge, after `moved` and `contradicted`. unknowns: limits of the evidence."""

    badge: str
    standing: str
    headline: str
    unknowns: tuple[str, ...]
    error: ErrorChange
    causes: tuple[BarSegment, ...]
    next: str
    command: str = ""
    """One or more lines."""
    tone: BadgeTone = "unjudged"
    action: str = ""
    """The next step in a few words, at the end of the first sentence."""
    sheet_causes: tuple[BarSegment, ...] = ()
    """The causes of a page, which has room for more."""


def with_next(summary: Summary, step: str, command: str, action: str) -> Summary:
    headline = summary.headline.replace(f"; {summary.action}.", f"; {action}." if action else ".", 1)
    return replace(summary, headline=headline, next=step, command=command, action=action)


_CHANGES_ARM = ("repair", "remaster", "enter", "check")


def with_corrections_removed(summary: Summary, kind: str, way: str, texts: Texts) -> Summary:
    """Also remove the correction, which would correct a repaired arm twice.

    kind: of the next act. way: how the robot was corrected.
    """
    if way == "none" or kind not in _CHANGES_ARM:
        return summary
    return replace(summary, next=f"{summary.next} {texts(f'then_without_{way}')}")


WITHOUT_FAULT = ("uncalibrated", "nothing_unusual", "unusual_group", "no_certain_fault")
"""Conditions in which the limits alone decide the colour of the badge."""


def with_driven_error(summary: Summary, before: Deviation, after: Deviation, texts: Texts) -> Summary:
    """The measured error before and after a correction; the limits behind the colour applied without it."""
    error = ErrorChange(
        now_label=texts("error_before_label"),
        now=error_size(before.um, before.u_um),
        after_label=texts("error_driven_label"),
        after=error_size(after.um, after.u_um),
        basis=texts("basis_driven"),
    ).with_remarks(texts, is_measured=before.u_um > 0)
    tones: dict[str, BadgeTone] = {"unusual_group": "watch", "no_certain_fault": "unjudged"}
    tone = tones.get(summary.standing, "pass") if summary.standing in WITHOUT_FAULT else summary.tone
    return replace(summary, error=error, tone=tone)


_MOST_CAUSES, _MOST_ON_SHEET = 3, 5
"""As many names as fit on a phone, and on the first page of a report."""
_MOST_RIVALS = 3
_LEAST_SHARE = 0.01
"""Chosen: the narrowest visible segment."""
_TENTH_PERCENT = 0.001
_UNDETERMINED = 0.5
"""Relative standard uncertainty of a size from which the size is not stated: half of it lies below twice that."""
_OPEN = ("cause_open", "ambiguous", "undecided", "unusual_group")
"""Headings of an open cause. A correction does not need the cause, and the first line says so."""
_UNDECIDED = ("out_of_range", "outside_library", "undecided", "not_testable_here")
"""Conditions under which no cause and no act is certain."""


def summarise(diagnosis: Diagnosis, texts: Texts = ENGLISH) -> Summary:
    words, acts = _SummaryWords(diagnosis, texts), without_idle_mounts(diagnosis.acts)
    act, causes = acts[0] if acts else None, words.leading()
    heading = words.heading(causes, act)
    action = words.action(act, heading) if act else ""
    first, *others = words.first_sentences(causes)
    return Summary(
        badge=words.texts(f"badge_{heading}"),
        standing=words.standing,
        tone=words.tone(causes),
        headline=joined([extended(first, action, "{}; {}."), *others]),
        unknowns=tuple(words.unknowns(act, first)),
        error=words.error,
        causes=tuple(words.segments(_MOST_CAUSES)),
        sheet_causes=tuple(words.segments(_MOST_ON_SHEET)),
        next=words.step(act) if act else "",
        command=words.commands(act) if act else "",
        action=action,
    )


@dataclass(frozen=True)
class _Cause:
    """is_single: an effect or the likely member of a group, not many small errors."""

    share: float
    words: str
    is_certain: bool
    is_fault: bool = False
    is_single: bool = True


class _SummaryWords(ActWords):
    @property
    def standing(self) -> str:
        diagnosis = self.diagnosis
        if diagnosis.contradictions or diagnosis.movements:
            return "contradicted" if diagnosis.contradictions else "moved"
        # Large scatter hides every other error, so that nothing is shown to be usual.
        if is_mostly_scatter(diagnosis):
            return "undecided"
        if any(part.share > LEAST_SHARE for part in unusual_groups(diagnosis)):
            return "unusual_group"
        return "no_certain_fault" if is_certain_except_small(diagnosis) else diagnosis.condition

    def heading(self, causes: Sequence[_Cause], act: Act | None) -> str:
        leads = bool(causes) and causes[0].is_certain
        may_lead = self.standing in (*WITHOUT_FAULT, "named", "ambiguous", "outside_library")
        if may_lead and leads:
            return "cause_found"
        if not may_lead or self.standing == "outside_library":
            return self.standing
        if self.standing == "named" and causes and not causes[0].is_single:
            return "uncalibrated"
        if is_complete(self.diagnosis):
            return "explained"
        if any(cause.is_single for cause in causes):
            return "cause_open"
        is_sound = self.standing in HARMLESS and act is not None and act.why == "sound"
        return "sound" if is_sound and self.diagnosis.accuracy.standing in (None, "pass") else self.standing

    @property
    def _is_within_limits(self) -> bool:
        """True if the accuracy requires no step."""
        return self.diagnosis.accuracy.standing == "pass" and self.standing in (*WITHOUT_FAULT, "named", "ambiguous")

    def tone(self, causes: Sequence[_Cause]) -> BadgeTone:
        """The colour of the badge: that of the accuracy if no fault was found."""
        standing = self.diagnosis.accuracy.standing
        if self.standing in WITHOUT_FAULT and standing == "fail":
            return "fail"
        if self.standing in HARMLESS and (standing == "pass" or (standing is None and not causes)):
            return "pass"
        return "unjudged" if self.standing in ("undecided", "no_certain_fault", "not_testable_here") else "watch"

    def first_sentences(self, causes: Sequence[_Cause]) -> list[str]:
        """What limits the conclusions, then the cause, small undecided parts and the unexplained error.

        The readings of a contradicted constant name no cause, because the constant must be checked first.
        """
        if self.diagnosis.contradictions:
            return self.preconditions
        is_shown = self._is_within_limits and self.diagnosis.standing
        remark = self.texts("fault_within_limits") if is_shown else ""
        undecided = self.usual_or_faults if is_certain_except_small(self.diagnosis) else ""
        cause = [self._cause(causes), *filter(None, [remark, undecided, self.unexplained_too])]
        before = self.preconditions
        # A scatter that only repeats can separate from errors does not come before a certain cause.
        is_found = any(known.is_certain for known in causes) and before == [self.unrepeated]
        return [*cause, *before] if is_found else [*before, *cause]

    def _cause(self, causes: Sequence[_Cause]) -> str:
        names_open = any(named.doubt == "commanded" for named in self.diagnosis.effects)
        condition = self.diagnosis.condition
        leads = bool(causes) and causes[0].is_certain
        is_unknown = condition == "out_of_range" or (condition == "outside_library" and not leads)
        is_unknown |= condition == "undecided" and names_open
        is_scatter = self.standing == "undecided" and condition != "undecided"
        is_group = self.standing == "unusual_group" and not any(cause.is_single for cause in causes)
        undecided = self.usual_or_faults
        is_minor = is_certain_except_small(self.diagnosis) or (causes and causes[0].is_fault)
        if not causes or is_unknown or is_scatter or is_group or (undecided and not is_minor):
            return capital(undecided or self.condition_sentence)
        first, *others = causes
        words = first.words
        if not first.is_fault and (faults := [cause for cause in others if cause.is_fault]):
            words = self.texts("also_a_fault", first=words, fault=faults[0].words)
        return capital(Phrase(f"{words}.", keys_of(words)))

    def leading(self) -> list[_Cause]:
        """Causes of the error: the largest certain one first, if it causes a large part of the error, then by share."""
        diagnosis, causes = self.diagnosis, []
        for named in diagnosis.standing:
            part, is_certain = part_of(diagnosis, named), is_certain_cause(diagnosis, named)
            share = part.share if part else 0.0
            causes.append(_Cause(share, self._effect(named, part, is_fault=True), is_certain, is_fault=True))
        for part in large_parts(diagnosis):
            is_single = part.index is not None or bool(part.likeliest and part.likeliest.odds >= LIKELY)
            is_certain = is_single and (has_certain_name(diagnosis, part) or self._is_usual_kind(part))
            if diagnosis.condition == "outside_library":
                named_part = diagnosis.named_of(part)
                is_certain &= named_part is not None and outweighs_unexplained(diagnosis, named_part)
            causes.append(_Cause(part.share, self._part(part), is_certain, is_single=is_single))
        for part in diagnosis.budget:
            # A small fault does not lead over a large part of which only the name is open.
            if diagnosis.standing and self._is_open_name(part):
                causes.append(_Cause(part.share, self._part(part), False))
            imitated = diagnosis.named_of(part)
            if part.share > LARGE_SHARE and imitated and imitated.doubt in IMITATED:
                why = self.texts(f"doubt_{imitated.doubt}")
                name = self.texts("not_confirmed_because", part=self.short_name(part), why=why)
                causes.append(_Cause(part.share, joined([name, self._share(part)], ", "), False))
        return sorted(causes, key=lambda cause: (not (cause.is_certain and cause.share > LARGE_SHARE), -cause.share))

    def _is_usual_kind(self, part: BudgetPart) -> bool:
        """True if only the name is open: the effect, or several small errors of its kind, certainly cause a part."""
        named = self.diagnosis.named_of(part)
        if named is None or likely_rivals(named) or not has_certain_contribution(self.diagnosis, part):
            return False
        return named.probability + named.alternatives.get("healthy", 0.0) >= CONFIRMED

    def _is_open_name(self, part: BudgetPart) -> bool:
        """True if a large part is certainly one of an effect, its rivals and usual errors, and it is open which."""
        named = self.diagnosis.named_of(part)
        if named is None or named.is_confirmed or named.doubt in IMITATED or part in large_parts(self.diagnosis):
            return False
        known = named.probability + sum(rival.probability for rival in named.rivals)
        return part.share > LARGE_SHARE and known + named.alternatives.get("healthy", 0.0) >= CONFIRMED

    def _share(self, part: BudgetPart) -> str:
        return self.texts("share_of_error", share=percent(min(part.share, 1.0)))

    def _part(self, part: BudgetPart) -> str:
        usual = self.texts("size_usual") if part.rank == "usual" else ""
        if named := self.diagnosis.named_of(part):
            if named.probability >= LIKELY or not self._is_usual_kind(part):
                return self._effect(named, part)
            kind = self.texts(f"part_{named.effect.part}", joint=self.joint(named.effect))
            member = joined([self.noun(named.effect), self.size_words(named)], ", ")
            name = joined([kind, usual, self._share(part)], ", ")
            return self.texts("possible_member", part=name, member=member, odds=sure(named.probability))
        likeliest = part.likeliest if part.likeliest and part.likeliest.odds >= LIKELY else None
        # The odds of a member assume that the group exists, so the doubt about the group is stated too.
        is_open = likeliest and not has_certain_contribution(self.diagnosis, part)
        uncertain = self.texts("size_uncertain", um=self.error_size(part.um, part.u_um)) if is_open else ""
        name = joined([self.short_name(part), usual, uncertain, self._share(part)], ", ")
        if likeliest is None:
            return name
        return self.texts("probable_member", part=name, member=self.noun(likeliest.effect), odds=sure(likeliest.odds))

    def _effect(self, named: Named, part: BudgetPart | None, *, is_fault: bool = False) -> str:
        """An effect with size, class and share, and its likely rivals; only the causes with their odds if none is
        likely.
        """
        share, likely = self._share(part) if part else "", likely_rivals(named)
        if named.probability < LIKELY and likely:
            causes = self.likeliest_first(named)[: _MOST_RIVALS + 1]
            odds = [self.with_odds(cause.effect, cause.probability) for cause in causes]
            return joined([self.texts("one_of", causes=self.texts("or").join(odds)), share], ", ")
        probable = "" if named.probability >= CONFIRMED else self.texts("likely", odds=sure(named.probability))
        rank = "fault" if is_fault else part.rank if part and part.rank in ("usual", "difference") else ""
        kind = self.texts(f"size_{rank}") if rank else ""
        first = joined([self._name_and_size(named), probable, kind, share], ", ")
        rivals = [*dict.fromkeys(self.noun(rival.effect) for rival in likely)]
        unlisted = len(rivals) - _MOST_RIVALS
        more = self.texts.counted("and_more_causes", unlisted) if unlisted > 0 else ""
        others = joined([self.texts("or").join(rivals[:_MOST_RIVALS]), more], ", ")
        return self.texts("otherwise", first=first, others=others) if rivals else first

    def _name_and_size(self, named: Named) -> str:
        """Name and size of an effect; of a certain change whose size is not determined, the change in µm."""
        effect, field = named.effect, size_field(named.effect)
        name = self.noun_with_twins(effect, named.twins)
        um = self.error_size(named.contribution_um, named.u_um)
        is_change_known = named.contribution_um > SURE_SIGMA * named.u_um
        if not is_change_known or named.sd.get(field, 0.0) < _UNDETERMINED * abs(getattr(effect, field)):
            return joined([name, self.size_words(named)], ", ")
        if is_wave(effect):
            return self.texts("smooth_error", joint=self.joint(effect), um=f"{um} µm")
        return self.texts("size_not_determined", name=name, um=f"{um} µm")

    def unknowns(self, act: Act | None, first: str) -> list[str]:
        diagnosis, against = self.diagnosis, self.against(act) if act else ""
        is_open = diagnosis.condition in _UNDECIDED and not self.usual_or_faults
        is_open &= self.standing != "no_certain_fault" or bool(self.unrepeated)
        key = "uncertain_load" if act and act.kind == "load" else "uncertain"
        sentences = [
            self._cause(self.leading()) if diagnosis.contradictions else "",
            self.visits,
            self.condition_sentence if is_open else "",
            self.follows,
            self.texts(key, against=against) if against else "",
        ]
        return [sentence for sentence in dict.fromkeys(sentences) if sentence not in ("", first)]

    def step(self, act: Act) -> str:
        step = self.imperative(act)
        return self.texts("optional_step", step=step) if self._is_optional(act) else step

    def action(self, act: Act, heading: str) -> str:
        if self._is_optional(act):
            return self.texts("do_nothing_necessary")
        if act.kind == "load" and heading == "outside_library":
            return self.texts("do_now_load_rest")
        is_open = act.kind == "load" and heading in _OPEN and not self.diagnosis.standing
        return self.texts("do_now_load_open") if is_open else self.action_of(act)

    def _is_optional(self, act: Act) -> bool:
        return self._is_within_limits and act.kind in ("load", "approach", *REPAIRS)

    @property
    def error(self) -> ErrorChange:
        """The error now and after the acts that reduce it, both on the runs used to validate the model.

        An assumed noise is no measured uncertainty, and the basis says so.
        """
        diagnosis, texts, accuracy = self.diagnosis, self.texts, self.diagnosis.accuracy
        gap = diagnosis.train if diagnosis.condition == "out_of_range" else judged_gap(diagnosis)
        now_um, after_um, after_u_um = accuracy.before_there_um, accuracy.calibrated_um, gap.residual_u_um
        label, basis, correction = self._after_label, f"basis_{accuracy.place}", self._correction_alone
        if correction:
            after_um, after_u_um = correction.residual_um, correction.remains_u_um or 0.0
        if not diagnosis.is_testable:
            label, basis = "", "basis_unknown"
        elif accuracy.place == "used" and is_complete(diagnosis):
            label, basis = "", "basis_now"
        elif diagnosis.condition == "out_of_range":
            now_um, after_um, after_u_um = accuracy.now_um, gap.after_um, gap.residual_u_um
            basis = "basis_out_of_range"
        elif accuracy.left_out_um is not None:
            basis = "basis_left_out"
            after_um, after_u_um = max((after_um, after_u_um), (accuracy.left_out_um, accuracy.left_out_u_um or 0.0))
        now, after = self.error_size(now_um, gap.u_um), self.error_size(after_um, after_u_um)
        # An error that the acts do not certainly reduce is not shown as one after them.
        is_same = after.partition(" ± ")[0] == now.partition(" ± ")[0]
        if not label or is_same or after_um + measured_u(diagnosis, after_u_um) >= now_um:
            after, basis = "", "basis_now" if basis == "basis_left_out" else basis
        is_split = after and basis == f"basis_{accuracy.place}" and not correction
        notes = [
            texts(basis),
            self._each_by_itself if is_split else "",
            texts("basis_moved") if diagnosis.movements else "",
        ]
        label_now = "error_uncorrected_label" if diagnosis.driven_corrected else "error_now_label"
        now_label = texts("error_left_by_model" if has_model(diagnosis) else label_now)
        change = ErrorChange(now_label, now, label, after, joined(notes), self.judged)
        return change.with_remarks(texts, is_measured=has_measured_noise(diagnosis))

    @property
    def _correction_alone(self) -> Act | None:
        """The correction, if it is the first act except measurements and compensates all faults: no repair is due."""
        diagnosis = self.diagnosis
        first = next((act for act in diagnosis.acts if act.kind != "measure"), None)
        is_valid = first and first.kind == "load" and first.removes and first.place == diagnosis.accuracy.place
        return first if is_valid and diagnosis.standing and not self.not_compensated else None

    @property
    def _after_label(self) -> str:
        """The acts after which the second error is reached."""
        acts = [self._correction_alone] if self._correction_alone else without_idle_mounts(self.diagnosis.acts)
        kinds = {act.kind for act in acts if act.kind == "check" or act.removes}
        ways = ["correction"] * bool(kinds & {"load", "approach"}) + ["repair"] * bool(kinds & {"check", *REPAIRS})
        return self.texts(f"error_after_{'_'.join(ways)}") if ways else ""

    @property
    def _each_by_itself(self) -> str:
        """The errors after only the correction and only the repairs; empty unless both exist."""
        acts = [act for act in self.diagnosis.acts if act.place == self.diagnosis.accuracy.place]
        corrections = [act for act in acts if act.kind == "load" and act.removes]
        # One that removes nothing by itself counts after the others, if it cancels a part of their errors.
        repairs = [act for act in acts if act.kind in REPAIRS and not act.conditional]
        repairs = [act for act in repairs if act.removes or act.with_before_um is not None]
        if not corrections or not any(act.removes for act in repairs):
            return ""
        after_all_um = repairs[-1].with_before_um  # None for a single repair
        repaired = micrometres(repairs[-1].residual_um if after_all_um is None else after_all_um)
        return self.texts("each_by_itself", corrected=micrometres(corrections[0].residual_um), repaired=repaired)

    def segments(self, most: int) -> list[BarSegment]:
        """The largest causes, and all others together."""
        parts = [part for part in self.diagnosis.budget[:most] if part.share >= _LEAST_SHARE]
        shares = [(self._cause_name(part), part.share, part.rank or "") for part in parts]
        rest = 1.0 - sum(min(part.share, 1.0) for part in parts)
        if parts and rest >= _TENTH_PERCENT:
            shares.append((self.texts("other_causes"), rest, ""))
        return [BarSegment(name, min(share, 1.0), f"{100 * share:.1f} %", rank) for name, share, rank in shares]

    def _cause_name(self, part: BudgetPart) -> str:
        """Name of a part, marked if an unknown cause may imitate it; an uncertain effect with its probability."""
        name, named = self.short_name(part), self.diagnosis.named_of(part)
        if named is None:
            return name
        if named.doubt in IMITATED:
            return f"{name} ({self.texts('not_confirmed')})"
        if named.probability >= CONFIRMED:
            return name
        if named.probability < LIKELY and likely_rivals(named):
            return self.texts("or").join(self.noun(cause.effect) for cause in self.likeliest_first(named))
        return f"{name} ({self.texts('likely', odds=sure(named.probability))})"
