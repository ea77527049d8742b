"""The answer of a diagnosis in sentences: condition, accuracy, what to do next, and the parts of the error.

Which sentence is said is decided here, once; the words come from the texts of a language. Screen and picture say it in
English, the page in its own language.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from analysis.inference.acts import Doubt
from analysis.inference.result import CERTAIN_ODDS, LARGE_SHARE, BudgetPart, Diagnosis, Named, is_sure, is_there
from analysis.reporting.diagnosis_words import likely_rivals, micrometres, percent, plain, size, sure
from analysis.reporting.texts import Texts, texts_of
from rigs.effects import Effect
from rigs.schema.effect import whole_order

SMALL_SHARE = 0.001
"""Share of the error below which parts that are not unusual are counted together."""
_WIDELY = 2.0
"""Times usual from which an effect of usual size that is sure is said beside what makes more. Chosen: one of twenty
arms without a fault shows as much of it."""
_MOST_NAMED = 3


def large_parts(found: Diagnosis) -> list[BudgetPart]:
    """What makes more than a third of the error and is no fault, so that the condition does not say it: what is sure,
    also where it may be one of a few, and groups of which the members are said."""
    faults = [part_of(found, one) for one in found.standing]
    return [
        one
        for one in found.budget
        if one.share > LARGE_SHARE
        and one.kind not in ("scatter", "unexplained")
        and one not in faults
        and (is_there(found, one) or one.members)
    ]


def sure_parts(found: Diagnosis) -> list[BudgetPart]:
    """Single effects that are sure, and larger than most arms show, though they are no fault and make less."""
    large = large_parts(found)
    return [
        one
        for one in found.budget
        if one.index is not None
        and one not in large
        and not found.effects[one.index].stands
        and is_sure(found, one)
        and (one.times_usual or 0.0) >= _WIDELY
    ]


def shown_parts(found: Diagnosis) -> tuple[list[BudgetPart], list[BudgetPart]]:
    """The parts of the error that have a line of their own, and the small ones that are counted together."""
    small = [one for one in found.budget if abs(one.share) < SMALL_SHARE and one.rank != "unusual"]
    return [one for one in found.budget if one not in small], small


def fields_of(effect: Effect) -> dict[str, Any]:
    """The parameters of an effect as a sentence says them, each in its own unit: the order of a gear as its teeth."""
    fields = effect.model_dump()
    return fields | ({"order": whole_order(fields["order"])} if "order" in fields else {})


@dataclass(frozen=True)
class AnswerWords:
    """The sentences of a diagnosis in a language."""

    found: Diagnosis
    texts: Texts = field(default_factory=partial(texts_of, "en"))

    @property
    def headline(self) -> str:
        """What is wrong, in a sentence: what makes most of the error before what makes less, what is sure before what
        is open, and then what these runs do not show."""
        found = self.found
        faults, large = self._faults(), self._large()
        share = sum(part.share for one in found.standing if (part := part_of(found, one)))
        first = any(one.share > share for one in large_parts(found))
        wrong = [*large, *faults] if first else [*faults, *large]
        said = "; ".join([*wrong, *self._open(), *self._sure_as_well()])
        sentence = f"{said[:1].upper()}{said[1:]}." if said else ""
        condition = self._condition()
        parts = (condition, sentence) if found.condition == "outside_library" else (sentence, condition)
        return " ".join(filter(None, parts))

    @property
    def accuracy(self) -> str:
        """The error now, and what the calibration leaves of it where it had no part, or on the runs used."""
        own = self.found.accuracy
        which = "error_corrected" if self.found.rig.calibrated else "error_now"
        now = self.texts(which, now=micrometres(own.now_um), largest=micrometres(own.now_largest_um))
        left = {"left": micrometres(own.calibrated_um), "before": micrometres(own.before_there_um)}
        return f"{now} {self.texts(f'calibrated_{own.place}', **left)}"

    @property
    def judged(self) -> str:
        """How the error now stands against its limits. Those of a rig file or a data sheet are of the arm as it drives:
        a calibration corrects targets, and no measured run was driven with them."""
        own = self.found.accuracy
        if own.standing is None or own.limit is None:
            return self.texts("accuracy_not_judged")
        by = self.texts(f"limit_{own.limit}")
        corrected = self.found.rig.calibrated and own.limit != "tolerance"
        which = "accuracy_uncorrected" if corrected else "accuracy_judged"
        return self.texts(which, standing=self.texts(f"standing_{own.standing}"), by=by)

    def part_name(self, part: BudgetPart) -> str:
        """A part of the budget as a person says it, with what cancels some of it."""
        name = self.short_name(part)
        return self.texts("with_cancelled", part=name, count=len(part.cancelled)) if part.cancelled else name

    def short_name(self, part: BudgetPart) -> str:
        """A part of the budget as a person says it, where there is no room for what cancels some of it."""
        if part.index is not None:
            return self.noun(self.found.effects[part.index].effect)
        if part.kind == "effect":
            return part.name
        return self.texts(f"part_{part.kind}", joint=self._joint(part.axis) if part.axis else "")

    def size_of(self, part: BudgetPart) -> str:
        """The size of a part that is an effect, ± its standard uncertainty; empty for others."""
        return size(self.found.effects[part.index]) if part.index is not None else ""

    def rank_of(self, part: BudgetPart) -> str:
        """The class of a part; empty where it has none."""
        return self.texts(f"rank_{part.rank}") if part.rank else ""

    def times_usual(self, part: BudgetPart) -> str:
        """How many times as much as usual a part does; empty where that has no meaning."""
        times = part.times_usual
        if times is None or not math.isfinite(times):
            return ""
        return self.texts("times_usual", times=f"{times:.1f}" if times >= 0.05 else "< 0.1")

    def noun(self, effect: Effect) -> str:
        """An effect as a person says it within a sentence."""
        words = self.texts.nouns.get(effect.effect)
        if words is None:
            return plain(self.found.rig, effect)
        axis = getattr(effect, "axis", None)
        return words.format(**fields_of(effect) | {"joint": self._joint(axis) if axis else ""})

    def _joint(self, axis: int) -> str:
        return self.texts.axis(self.found.rig.robot, axis)

    def _condition(self) -> str:
        """What these runs do not show, or that nothing was found; empty where faults say it all."""
        found, texts = self.found, self.texts
        left = {"um": micrometres(found.remainder.um), "share": percent(found.remainder.share)}
        if found.condition in ("named", "ambiguous"):
            return ""
        single = any(one.index is not None for one in large_parts(found))
        which = "nothing_unusual" if found.condition == "uncalibrated" and single else found.condition
        return " ".join(filter(None, [texts(f"says_{which}", **left), self._held()]))

    def _faults(self) -> list[str]:
        """The faults that are sure, as a part of a sentence."""
        sure, open_ones = self._by_certainty()
        if sure:
            which = "says_fault" if len(sure) == 1 else "says_faults"
            return [self.texts(which, faults=self._listed([*map(self._fault, sure)]), count=len(sure))]
        if open_ones:
            return [self.texts("says_ambiguous", faults=self._listed([*map(self._alternatives, open_ones)]))]
        return []

    def _open(self) -> list[str]:
        """The faults that have rivals, where others are sure."""
        sure, open_ones = self._by_certainty()
        if not sure or not open_ones:
            return []
        return [self.texts("says_open", faults=self._listed([*map(self._alternatives, open_ones)]))]

    def _by_certainty(self) -> tuple[list[Named], list[Named]]:
        sure = [one for one in self.found.standing if one.posterior >= CERTAIN_ODDS]
        return sure, [one for one in self.found.standing if one not in sure]

    def _sure_as_well(self) -> list[str]:
        said = [self._measured(one) for one in sure_parts(self.found)]
        return [self.texts("says_sure", parts=self._listed(said))] if said else []

    def _held(self) -> str:
        """What the rig file names already, so that nothing found means nothing more; empty where it names nothing."""
        held = list(dict.fromkeys(map(self.noun, self.found.rig.effects)))
        return self.texts("already_held", effects=self._listed(held)) if held else ""

    def _large(self) -> list[str]:
        """What makes more than a third of the error and is no fault, as parts of a sentence."""
        return [self._large_part(one) for one in large_parts(self.found)]

    def _large_part(self, part: BudgetPart) -> str:
        share = percent(min(part.share, 1.0))
        if part.index is not None and likely_rivals(one := self.found.effects[part.index]):
            effects = (one.effect, *(rival.effect for rival in likely_rivals(one)))
            return self.texts("large_part", share=share, part=self.texts("or").join(map(self.noun, effects)))
        if not part.members:
            return self.texts("large_part", share=share, part=self._measured(part))
        members = ", ".join(f"{self.noun(one.effect)} ({sure(one.odds)})" for one in part.members)
        return self.texts("large_group", share=share, part=self.short_name(part), members=members)

    def _measured(self, part: BudgetPart) -> str:
        said = []
        if part.index is not None:
            odds = self.found.effects[part.index].posterior
            said = [self.size_of(part), self.times_usual(part), sure(odds) if odds < CERTAIN_ODDS else ""]
        beside = ", ".join(filter(None, said))
        return f"{self.short_name(part)} ({beside})" if beside else self.short_name(part)

    def _listed(self, said: Sequence[str]) -> str:
        more = [self.texts("and_more", count=len(said) - _MOST_NAMED)] if len(said) > _MOST_NAMED else []
        return "; ".join([*said[:_MOST_NAMED], *more])

    def _fault(self, one: Named) -> str:
        return ", ".join([self.noun(one.effect), size(one), *self._share(one)])

    def _alternatives(self, one: Named) -> str:
        """A fault and those of its rivals that cannot be dismissed."""
        effects = (one.effect, *(rival.effect for rival in likely_rivals(one)))
        return ", ".join([self.texts("or").join(map(self.noun, effects)), *self._share(one)])

    def _share(self, one: Named) -> list[str]:
        part = part_of(self.found, one)
        if part is None:
            return []
        return [self.texts("share_of_error", share=percent(min(max(part.share, 0.0), 1.0)))]


def part_of(found: Diagnosis, one: Named) -> BudgetPart | None:
    """The part of the budget that an effect makes."""
    return next((part for part in found.budget if part.index is not None and found.effects[part.index] is one), None)


def doubt_words(doubt: Doubt, texts: Texts) -> str:
    """Why the diagnosis does not stand by an effect."""
    return texts(f"doubt_{doubt}")
