"""Recommended acts in sentences for screen, page, session and history: the act, the expected error, and the arguments
against it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile

from analysis.apps.report.answer_words import AnswerWords
from analysis.apps.report.diagnosis_words import act_after, micrometres, percent, with_uncertainty
from analysis.apps.report.texts import extended, joined
from analysis.correction.work import largest_move_mm
from analysis.diagnosis.fit.selection_state import LEAST_SHARE
from analysis.diagnosis.judge.acts import FOUND, Act
from analysis.diagnosis.plan.plan_next import JOINED
from analysis.robot.predict import is_geometric
from rigs.effects import Effect, size_field
from rigs.rig import Rig
from rigs.schema.effect import label_of, name_of
from rigs.text import as_argument

REPAIRS = ("repair", "remaster", "enter", "mount")
"""Kinds of acts that change the arm or its set-up, so that a correction from the same runs no longer fits."""
_TOUCHED_UP_MM = 0.05
"""Error of a taught point below which nobody touches it up: the repeatability of an industrial robot."""
_KEYS = {
    "few_runs": "next_repeat", "one_lap": "act_one_lap", "elsewhere": "act_elsewhere", "revisit": "act_revisit",
    "commanded": "act_commanded",
    "not_visible": "next_plan", "visits_differ": "act_repeats_differ", "gauges_differ": "act_gauges_differ",
}  # fmt: skip
"""Text keys of measurements by their reason."""


class ActWords(AnswerWords):
    @property
    def next(self) -> str:
        act = self.diagnosis.next_act
        return self.sentence(act) if act else ""

    def sentence(self, act: Act, *, corrected: bool = False) -> str:
        """An act with the expected gain and the arguments against it.

        corrected: leaves out the effect of the act on the correction, which the caller states once for all acts.
        """
        earlier = {one.kind for one in takewhile(lambda one: one != act, self.diagnosis.acts)}
        is_otherwise = act.kind == "load" and "check" in earlier
        key = "act_otherwise" if is_otherwise else "act_if_confirmed" if act.conditional else ""
        condition = self.texts(key) if key else ""  # before the command that it restricts
        # The act changes the arm for which an earlier act in the list makes a correction.
        is_instead = "load" in earlier and act.kind in (*REPAIRS, "check")
        instead = self.texts("act_instead") if is_instead and not corrected else ""
        sentence = joined([condition, self.what(act), self.removes(act), instead, self.about_taught_points(act)])
        against = self.against(act)
        return extended(sentence, against, "{} ({}).")

    def what(self, act: Act) -> str:
        texts = self.texts
        if act.kind == "none":
            return self._none(act)
        if act.kind == "measure":
            return self._measure(act)
        if act.why == "moved":
            return act_after(self.diagnosis.movements, texts)
        if act.why == "contradicted":
            made = self.diagnosis.contradictions
            stated = ", ".join(dict.fromkeys(contradiction.key for contradiction in made))
            return texts("act_check_contradicted", constants="; ".join(map(self.constant_name, made)), keys=stated)
        if act.effect is None:
            rig = self.diagnosis.rig
            key = f"act_{act.kind}" + load_variant(rig) * (act.kind == "load")
            keys = (f"{key}_{act.why}", *[f"{key}_unwritten"] * bool(self._unwritten_model(act)), key)
            return self.of_places(*keys, command=command(act), maker=rig.maker or "MAKER")
        kind, part = act.kind, {"clocks": "gauges"}.get(act.effect.part, act.effect.part)
        ends = (f"_{act.effect.effect}", f"_{part}", f"_{act.why}", "")
        field = size_field(act.effect)
        size = with_uncertainty(act.effect, field, {field: act.u} if act.u is not None else {})
        twins = next((named.twins for named in self.diagnosis.effects if named.effect == act.effect), ())
        return texts(
            *(f"act_{kind}{end}" for end in ends),
            cause=self.noun_with_twins(act.effect, twins),
            size=size if act.kind != "remaster" or size.startswith("-") else f"+{size}",
            axis=self.joint(act.effect),
        )

    def about_taught_points(self, act: Act) -> str:
        """What becomes of programs with taught points once values are entered; empty if nothing is entered."""
        rig, calibrated = self.diagnosis.rig, self.diagnosis.calibrated
        effects = [act.effect] if act.effect else [named.effect for named in self.diagnosis.effects]
        effects += calibrated.effects if calibrated and not act.effect else ()
        entered = [effect for effect in effects if is_geometric(effect)]
        is_entered = act.kind in ("enter", "remaster") or (act.kind == "load" and not load_variant(rig))
        if not (is_entered and entered and rig.takes_programs):
            return ""
        mm = largest_move_mm(rig, entered)
        return self.texts(f"act_taught_{act.kind}", mm=f"{mm:.2g}") if mm >= _TOUCHED_UP_MM else ""

    def imperative(self, act: Act) -> str:
        if act.conditional:
            return joined([self.texts("act_if_confirmed"), self.what(act)])
        if act.kind != "load":
            return self.texts("do_convert") if act.kind == "convert" else self.what(act)
        step = self.texts(f"do_load{load_variant(self.diagnosis.rig)}")
        return joined([step, self.texts("do_write_model") if self._unwritten_model(act) else ""])

    def commands(self, act: Act) -> str:
        """The command of an act, and of a correction also the command that uses the model written by the first."""
        if not (model := self._unwritten_model(act)):
            return command(act)
        option = {"_joints": " --program FILE --points computed", "_targets": " --path TARGETS.csv"}
        corrects = option.get(load_variant(self.diagnosis.rig), "")
        return f"{command(act)}\nrig correct {as_argument(model)}{corrects} -o corrections"

    def _unwritten_model(self, act: Act) -> str:
        """The rig file that the command of a correction writes first; empty for `rig correct`, which reads it."""
        words, name = act.command, f"{self.diagnosis.rig.name}.yaml"
        if act.kind != "load" or not words:
            return ""
        if words[0] == "correct":
            return f"found/{name}" if words[1].startswith(FOUND) else ""
        return words[-1] if words[-1].endswith(".yaml") else f"{words[-1]}/{name}"

    def action_of(self, act: Act) -> str:
        """An act in a few words. A correction says whether it compensates the faults or precedes their repair."""
        if act.kind == "load" and self.diagnosis.standing:
            names = dict.fromkeys(self._numbered(effect) or self.noun(effect) for effect in self.not_compensated)
            key = "do_now_load_first" if names else "do_now_load_fault"
            return self.texts(key, axes=self.texts("and").join(names))
        axis, key = self._numbered(act.effect), f"do_now_{act.kind}"
        return self.of_places(f"do_now_{act.why}", *[f"{key}_axis"] * bool(axis), key, axis=axis)

    @property
    def not_compensated(self) -> list[Effect]:
        """Faults that no correction removes."""
        faults = [named.effect for named in self.diagnosis.standing]
        return [effect for effect in faults if effect.compensation().use == "none"]

    def _numbered(self, effect: object) -> str:
        """`axis 4` of an effect, which the line has already named; empty if it has none."""
        axis = getattr(effect, "axis", None)
        return self.texts("axis_numbered", axis=axis) if axis else ""

    def _none(self, act: Act) -> str:
        indices = [self.diagnosis.budget[k].index for k in act.parts if act.why == "sound"]
        effects = [self.diagnosis.effects[k].effect for k in indices if k is not None]
        avoidable = ", ".join(self.noun(effect) for effect in effects if effect.part == "reversal")
        is_within = act.why == "sound" and self.diagnosis.accuracy.standing == "pass"
        sentence = self.texts(f"act_none_{act.why}{'_within' * is_within}", parts=self.parts(act))
        return joined([sentence, self.texts("act_none_sound_avoidable", parts=avoidable)]) if avoidable else sentence

    def removes(self, act: Act) -> str:
        """The error expected after an act, and where it was estimated; empty for acts that remove no error."""
        if act.kind in ("none", "measure") or (act.effect is None and act.kind != "load"):
            return ""
        if act.removes_um is None or act.remains_um is None:
            return self.texts("act_not_computed")
        before = act.removes_um + act.remains_um
        change = act.removes_um / before if before > 0 else 0.0
        falls = f"act_{'load_' * (act.kind == 'load' and self.diagnosis.rig.takes_programs)}changes"
        key = "hardly" if abs(change) < LEAST_SHARE else "may_change" if change > 0 else "grows"
        sentence = self.texts(
            falls if act.removes else f"act_{key}", before=micrometres(before),
            after=f"{self.error_size(act.remains_um, act.remains_u_um)} µm",
            place=self.texts(f"place_{'left_out' if self._is_left_out(act) else act.place}"),
        )  # fmt: skip
        if act.with_before_um is not None:
            after = f"{self.error_size(act.with_before_um, act.with_before_u_um)} µm"
            if key == "grows":  # the preceding acts remove errors that this one cancels
                return self.texts("act_only_with_before", after=after)
            return joined([sentence, self.texts("act_with_before", after=after)])
        # Parts that this effect cancels become visible in full once it is removed.
        lines = [line for k in act.parts for line in self.diagnosis.budget[k].shown_together] if act.effect else []
        others = [line for line in lines if act.effect and line.label != label_of(act.effect)]
        is_uncovered = 0 < len(others) < len(lines)
        uncovered = "; ".join(self.describe_parts_alone(others))
        return joined([self.texts("act_uncovers", others=uncovered) if is_uncovered else "", sentence])

    def _is_left_out(self, act: Act) -> bool:
        """True if the error after a correction is that of readings left out, each predicted from the others."""
        return act.kind == "load" and act.place == "used" and self.diagnosis.accuracy.left_out_um is not None

    def against(self, act: Act) -> str:
        named = next((named for named in self.diagnosis.effects if named.effect == act.effect), None)
        nouns = {name_of(rival.effect): self.noun(rival.effect) for rival in (named.rivals if named else ())}
        # The instruction of a measurement already mentions the missing place, the error after the act its validation
        stated = {"not_judged_elsewhere", *["no_place"] * (act.kind == "measure" and act.test is None)}
        phrases = []
        for remark in (remark for remark in act.against if remark.why not in stated):
            names = self.texts("or").join(nouns.get(name, name) for name in remark.names)
            key = f"doubt_{remark.doubt}" if remark.doubt else f"against_{remark.why}"
            phrases.append(self.texts(key, names=names, count=remark.runs))
        return joined(phrases, "; ")

    def parts(self, act: Act) -> str:
        return ", ".join(self.part_name(self.diagnosis.budget[k]) for k in act.parts)

    def _measure(self, act: Act) -> str:
        texts, test = self.texts, act.test
        if act.why in _KEYS:
            cause = self.noun(act.effect) if act.effect else ""
            earlier = {one.kind for one in takewhile(lambda one: one != act, self.diagnosis.acts)}
            later = "_later" if act.why == "elsewhere" and "load" in earlier else ""
            return self.of_places(f"{_KEYS[act.why]}{later}", cause=cause, count=act.runs)
        if act.why == "follows" and (followed := self.diagnosis.residual.likeliest):
            return texts(f"act_follows_{followed.what}", joint=self.joint(followed))
        if test is None:
            key = "next_elsewhere" if act.why == "rivals" else "act_group_no_test"
            return self.of_places(key, parts=self.parts(act))
        share = percent(sum(self.diagnosis.budget[k].share for k in act.parts))
        if test.test == JOINED:
            return texts("act_joined", parts=self.parts(act), share=share)
        minutes = texts("minutes", count=max(1, round(act.cost.minutes))) if act.cost.minutes else texts("zero_minutes")
        which = "act_rivals" if act.why == "rivals" else "act_group"
        return texts(which, test=test.test, minutes=minutes, parts=self.parts(act), share=share)


def without_idle_mounts(acts: Sequence[Act]) -> tuple[Act, ...]:
    """The acts except remounting with negligible gain, or all if no other act exists."""
    idle = [
        act
        for act in acts
        if act.kind == "mount"
        and act.effect is not None
        and act.removes_um is not None
        and abs(act.removes_um) <= LEAST_SHARE * (act.removes_um + act.residual_um)
    ]
    return tuple(act for act in acts if act not in idle) or tuple(acts)


def load_variant(rig: Rig) -> str:
    """Suffix of the texts on corrected targets, by what `rig correct` corrects for an arm."""
    if not rig.takes_programs:
        return "_targets"
    return "_joints" if rig.controller == "unknown" else ""


def command(act: Act) -> str:
    """Command line of an act, or of the diagnosis that writes the missing model; empty if there is none."""
    if any(word.startswith(FOUND) for word in act.command):
        return "rig diagnose RUN… -o found" if act.kind == "load" else ""
    return " ".join(["rig", *act.command]) if act.command else ""
