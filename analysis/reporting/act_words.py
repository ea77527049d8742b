"""Acts in sentences: what to do, what it takes the error to and where that was found, and what speaks against it.

The acts are values (`analysis.inference.acts`); nothing is decided here. Screen, page, session and history say them
with these words.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

from analysis.inference.acts import Act, Against
from analysis.inference.naming_tests import JOINED
from analysis.inference.result import Diagnosis, Member
from analysis.reporting.answer_words import AnswerWords
from analysis.reporting.diagnosis_words import micrometres, percent, sure, with_uncertainty, within
from analysis.reporting.texts import Texts, texts_of
from rigs.effects import Effect, size_field
from rigs.schema.effect import name_of


@dataclass(frozen=True)
class ActWords:
    """The sentences of the acts of a diagnosis in a language."""

    found: Diagnosis
    texts: Texts = field(default_factory=partial(texts_of, "en"))

    @property
    def next(self) -> str:
        """The first act, what it removes, and what speaks against it; empty where there is none."""
        act = self.found.next_act
        return self.sentence(act) if act else ""

    def sentence(self, act: Act) -> str:
        """An act in full: what to do, what that removes, and what speaks against it."""
        against = self.against(act)
        said = " ".join(filter(None, [self.what(act), self.removes(act)]))
        return f"{said.removesuffix('.')} ({against})." if against else said

    def what(self, act: Act) -> str:
        """What to do, as a sentence."""
        texts = self.texts
        if act.kind == "none":
            return texts(f"act_none_{act.why}", parts=self.parts(act))
        if act.kind == "measure":
            return self._measure(act)
        if act.effect is None:
            own = {"mount": self._of_places("act_mount_unexplained"), "wait": "act_wait_early"}
            return texts(own.get(act.kind, f"act_{act.kind}"), command=command(act))
        key = f"act_repair_{act.why}" if act.kind == "repair" and act.why != "fault" else f"act_{act.kind}"
        return texts(key, cause=self.noun(act.effect), size=self._size(act), axis=self._axis(act.effect))

    def removes(self, act: Act) -> str:
        """What the error falls to, ± its standard uncertainty, and where; empty for acts that remove nothing."""
        if act.kind in ("none", "measure", "approach") or (act.effect is None and act.kind != "load"):
            return ""
        before = act.removes_um + act.remains_um
        key = "act_changes" if act.removes else "act_hardly"
        return self.texts(
            key, before=micrometres(before), after=within(act.remains_um, act.remains_u_um),
            place=self.texts(f"place_{act.place}"),
        )  # fmt: skip

    def against(self, act: Act) -> str:
        """What speaks against it, in a few words; empty where nothing does."""
        own = [
            one for one in act.against if not (act.kind == "measure" and act.test is None and one.why == "no_place")
        ]  # its own words say that
        return "; ".join(self._against(act, one) for one in own)

    def members(self, members: Sequence[Member]) -> str:
        """What a group may be, each with its odds."""
        return ", ".join(f"{self.noun(one.effect)} ({sure(one.odds)})" for one in members)

    def noun(self, effect: Effect) -> str:
        """An effect as a person says it within a sentence."""
        return AnswerWords(self.found, self.texts).noun(effect)

    def parts(self, act: Act) -> str:
        """The parts of the error that an act serves."""
        words = AnswerWords(self.found, self.texts)
        return ", ".join(words.part_name(self.found.budget[k]) for k in act.parts)

    def _measure(self, act: Act) -> str:
        texts, test = self.texts, act.test
        if act.why == "few_runs":
            return texts("next_repeat", count=act.runs)
        if act.why == "not_visible":
            return texts(self._of_places("next_plan"))
        if act.why == "elsewhere":
            return texts("act_elsewhere")
        if test is None:
            key = "next_elsewhere" if act.why == "rivals" else self._of_places("act_group_no_test")
            return texts(key, parts=self.parts(act))
        share = percent(sum(self.found.budget[k].share for k in act.parts))
        if test.test == JOINED:
            return texts("act_joined", parts=self.parts(act), odds=sure(test.odds_then), share=share)
        minutes = texts("minutes", count=f"{act.cost.minutes:.0f}") if act.cost.minutes else texts("no_minutes")
        which = "act_rivals" if act.why == "rivals" else "act_group"
        return texts(
            which, test=test.test, minutes=minutes, parts=self.parts(act),
            odds=sure(test.odds_then), share=share,
        )  # fmt: skip

    def _of_places(self, key: str) -> str:
        """The sentence of a key; where only poses or touches were measured, that for people without ball and gauges."""
        tests = {name.split()[0].strip(",;") for name in self.found.setups}
        return f"{key}_places" if tests and tests <= {"pose", "touch"} else key

    def _axis(self, effect: Effect) -> str:
        axis = getattr(effect, "axis", None)
        return self.texts.axis(self.found.rig.robot, axis) if axis else ""

    def _size(self, act: Act) -> str:
        assert act.effect is not None  # noqa: S101 - asked of acts that have one
        own = size_field(act.effect)
        return with_uncertainty(act.effect, own, {own: act.u} if act.u is not None else {})

    def _against(self, act: Act, one: Against) -> str:
        texts = self.texts
        rivals = [rival.effect for named in self.found.effects if named.effect == act.effect for rival in named.rivals]
        said = {name_of(effect): self.noun(effect) for effect in rivals}
        if one.why == "doubt" and one.doubt:
            return texts(f"doubt_{one.doubt}")
        count = "" if one.runs is None else one.runs
        return texts(
            f"against_{one.why}", names=texts("or").join(said.get(name, name) for name in one.names), count=count
        )


def acts_in_words(found: Diagnosis, texts: Texts) -> list[str]:
    """Every act of a diagnosis as a sentence, the first one first."""
    words = ActWords(found, texts)
    return [words.sentence(act) for act in found.acts]


def command(act: Act) -> str:
    """The command of an act as a person types it; empty where none does it."""
    return " ".join(["rig", *act.command]) if act.command else ""
