"""The answer of a diagnosis in sentences: condition, accuracy, what to do next, and the parts of the error.

Which sentence is said is decided here, once; the words come from the texts of a language. Screen and picture say it in
English, the page in its own language.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Literal

from analysis.inference.acts import Doubt
from analysis.inference.budget import CERTAIN_SIGMA, LARGE_SHARE
from analysis.inference.result import BudgetPart, Condition, Diagnosis, Named
from analysis.reporting.diagnosis_words import likely_rivals, micrometres, percent, plain, size
from analysis.reporting.texts import Texts, texts_of
from rigs.effects import Effect

NextStep = Literal["repair", "separate", "elsewhere", "repeat", "look", "plan", "calibrate", "unseen", "nothing"]
"""What a person does next: repair the faults; drive the test that separates rivals, or measure elsewhere where there is
none; repeat; look whether the set-up is sound; plan tests that show something; calibrate; measure where the calibration
had no part; or nothing."""
SMALL_SHARE = 0.001
"""Share of the error below which parts that are not unusual are counted together."""
_GAINS = 0.8
"""Share of the error up to which what remains after the calibration makes it worth while. Chosen: a fifth less."""
_MOST_NAMED = 3
_IMITATES: tuple[Doubt, ...] = ("contradicted", "series", "no_better")
"""Doubts of effects that stand for something else, so that the error comes from no such cause."""

_STEPS: dict[Condition, NextStep] = {
    "named": "repair",
    "undecided": "repeat",
    "outside_library": "look",
    "not_testable_here": "plan",
    "uncalibrated": "calibrate",
}


def next_step(found: Diagnosis) -> NextStep:
    """What to do next."""
    if found.condition in _STEPS:
        return _STEPS[found.condition]
    if found.condition == "ambiguous":
        return "separate" if found.next_test else "elsewhere"
    own = found.accuracy
    if own.standing in ("watch", "fail") and own.calibrated_um < _GAINS * own.before_there_um:
        return "calibrate"
    return "unseen" if own.place == "used" else "nothing"


def large_parts(found: Diagnosis) -> list[BudgetPart]:
    """What makes more than a third of the error for certain and is no fault, so that the condition does not say it."""
    large = [one for one in found.budget if one.share > LARGE_SHARE and one.sigma >= CERTAIN_SIGMA]
    faults = [part_of(found, one) for one in found.standing]
    said = [*faults, *(one for one in large if one.doubt in _IMITATES)]
    return [one for one in large if one.kind not in ("scatter", "unexplained") and one not in said]


def shown_parts(found: Diagnosis) -> tuple[list[BudgetPart], list[BudgetPart]]:
    """The parts of the error that have a line of their own, and the small ones that are counted together."""
    small = [one for one in found.budget if abs(one.share) < SMALL_SHARE and one.rank != "unusual"]
    return [one for one in found.budget if one not in small], small


@dataclass(frozen=True)
class AnswerWords:
    """The sentences of a diagnosis in a language."""

    found: Diagnosis
    texts: Texts = field(default_factory=partial(texts_of, "en"))

    @property
    def headline(self) -> str:
        """The condition of the arm in a sentence, and in another one what makes more than a third of its error."""
        condition, large = self._condition(), self._large()
        # What is certain comes before what is not known, and what makes more of the error before what makes less.
        share = sum(part.share for one in self.found.standing if (part := part_of(self.found, one)))
        first = any(one.share > share for one in large_parts(self.found)) and self.found.condition == "named"
        parts = (large, condition) if first or self.found.condition == "undecided" else (condition, large)
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

    @property
    def next_step(self) -> str:
        """What to do next."""
        step, test = next_step(self.found), self.found.next_test
        given = {"count": self.found.runs_to_decide, "test": test.test if test else ""}
        return self.texts(f"next_{step}", **given)

    def part_name(self, part: BudgetPart) -> str:
        """A part of the budget as a person says it."""
        if part.index is not None:
            return self.noun(self.found.effects[part.index].effect)
        if part.kind == "effect":
            return part.name
        return self.texts(f"part_{part.kind}", joint=self._joint(part.axis) if part.axis else "")

    def size_of(self, part: BudgetPart) -> str:
        """The size of a part that is an effect, ± its standard uncertainty; empty for others."""
        return size(self.found.effects[part.index]) if part.index is not None else ""

    def rank_of(self, part: BudgetPart) -> str:
        """The class of a part; empty where it has none. What is unusual though other arms show as much is so because
        this arm shows less elsewhere."""
        if part.rank is None:
            return ""
        here = part.rank == "unusual" and part.times_usual is not None and part.times_usual <= 1
        return self.texts("rank_unusual_here" if here else f"rank_{part.rank}")

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
        return words.format(**effect.model_dump() | {"joint": self._joint(axis) if axis else ""})

    def _joint(self, axis: int) -> str:
        return self.texts("joint_of", axis=axis, name=self.found.rig.robot.axes[axis - 1].name)

    def _condition(self) -> str:
        found, texts = self.found, self.texts
        faults, count = self._listed([*map(self._fault, found.standing)]), len(found.standing)
        left = {"um": micrometres(found.remainder.um), "share": percent(found.remainder.share)}
        match found.condition:
            case "named":
                return texts("says_fault" if count == 1 else "says_faults", faults=faults, count=count)
            case "ambiguous":
                return texts("says_ambiguous", faults=self._listed([*map(self._alternatives, found.standing)]))
            case "outside_library" if count:
                return texts("says_outside_beside", faults=faults, **left)
        return " ".join(filter(None, [texts(f"says_{found.condition}", **left), self._held()]))

    def _held(self) -> str:
        """What the rig file names already, so that nothing found means nothing more; empty where it names nothing."""
        held = list(dict.fromkeys(map(self.noun, self.found.rig.effects)))
        return self.texts("already_held", effects=self._listed(held)) if held else ""

    def _large(self) -> str:
        """What makes more than a third of the error and is no fault, as a sentence; empty where nothing does."""
        parts = large_parts(self.found)
        said = [self.texts("large_part", share=percent(one.share), part=self._measured(one)) for one in parts]
        return f"{'; '.join(said)}." if said else ""

    def _measured(self, part: BudgetPart) -> str:
        beside = ", ".join(filter(None, [self.size_of(part), self.times_usual(part)])) if part.index is not None else ""
        return f"{self.part_name(part)} ({beside})" if beside else self.part_name(part)

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
        return [self.texts("share_of_error", share=percent(part.share))] if part else []


def part_of(found: Diagnosis, one: Named) -> BudgetPart | None:
    """The part of the budget that an effect makes."""
    return next((part for part in found.budget if part.index is not None and found.effects[part.index] is one), None)


def doubt_words(doubt: Doubt, texts: Texts) -> str:
    """Why the diagnosis does not stand by an effect."""
    return texts(f"doubt_{doubt}")
