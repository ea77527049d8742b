"""Sentences of a diagnosis: condition, accuracy, next step, and parts of the error, in the texts of a language."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from analysis.apps.report.diagnosis_words import (
    LEAST_ODDS,
    error_size,
    measured_u,
    micrometres,
    movement_sentence,
    percent,
    size,
    sure,
)
from analysis.apps.report.texts import ENGLISH, Texts, capital, joined
from analysis.diagnosis.fit.contradictions import Contradiction
from analysis.diagnosis.fit.refine import size_limits
from analysis.diagnosis.fit.selection_state import LEAST_SHARE
from analysis.diagnosis.judge.acts import IMITATED
from analysis.diagnosis.judge.budget_part import LARGE_SHARE, BudgetPart, GroupMember
from analysis.diagnosis.judge.certainty import fault_rivals, has_certain_contribution, has_certain_name, likely_rivals
from analysis.diagnosis.judge.named import Named, Rival
from analysis.diagnosis.judge.result import Diagnosis, Gap
from analysis.diagnosis.judge.verdict import is_undecided
from analysis.procedures.shared.quantity import quantity_of
from rigs.effect_names import name_in_words
from rigs.effects import Effect
from rigs.schema.effect import name_of, size_field, whole_order

HARMLESS = ("uncalibrated", "nothing_unusual")
"""Conditions without a fault."""
SMALL_SHARE = 0.001
"""Share of the error below which ordinary parts are counted together."""
_MOST_NAMED = 3
_SMALL_PAYLOAD = 0.02
"""Share of the mass of the arm below which a payload hardly changes the softness that explains a deflection."""
LIKELY = 0.5
"""Odds below which a cause is not the likeliest: another cause is likelier."""


def large_parts(diagnosis: Diagnosis) -> list[BudgetPart]:
    """Parts above a third of the error, except faults, with a certain cause or named members."""
    faults = [part_of(diagnosis, named) for named in diagnosis.standing]
    return [
        part
        for part in diagnosis.budget
        if part.share > LARGE_SHARE
        and part.kind not in ("scatter", "unexplained")
        and part not in faults
        and (has_certain_contribution(diagnosis, part) or part.members)
    ]


def is_mostly_scatter(diagnosis: Diagnosis) -> bool:
    """True if the scatter of the measured places is so large that smaller errors cannot be recognised."""
    share = sum(part.share for part in diagnosis.budget if part.kind == "scatter")
    return diagnosis.residual.scatter_um is not None and share > LARGE_SHARE


def is_certain_except_small(diagnosis: Diagnosis) -> bool:
    """True if an undecided diagnosis is certain about a large part of the error, and open only in small parts.

    A fault in a small part cannot be the first act, because acts are sorted by gain.
    """
    residual = diagnosis.residual
    if diagnosis.condition != "undecided" or residual.scatter_um:
        return False
    open_share = sum(share_of(diagnosis, named) for named in diagnosis.effects if is_open_cause(diagnosis, named))
    certain = [part for part in large_parts(diagnosis) if has_certain_name(diagnosis, part)]
    return open_share <= LEAST_SHARE and bool(certain)


def is_open_cause(diagnosis: Diagnosis, named: Named) -> bool:
    """True if more runs may find a fault, and not only the size of a certain contribution is open."""
    part = part_of(diagnosis, named)
    is_size_open = named.doubt == "unsure" and part is not None and has_certain_name(diagnosis, part)
    return is_undecided([named]) and not is_size_open


def unusual_groups(diagnosis: Diagnosis) -> list[BudgetPart]:
    """Groups of small errors that are larger than usual; none if a fault or an open cause explains the error."""
    groups = [part for part in diagnosis.budget if part.rank == "unusual" and part.index is None]
    return groups if diagnosis.condition in HARMLESS else []


def has_model(diagnosis: Diagnosis) -> bool:
    """True if the rig file contains effects or a calibration. The robot drives without them."""
    return diagnosis.rig.calibrated is not None or bool(diagnosis.rig.effects)


def is_complete(diagnosis: Diagnosis) -> bool:
    """True if scatter makes up more than nine tenths of the error that the model of the rig file leaves."""
    scatter = sum(part.share for part in diagnosis.budget if part.kind == "scatter")
    return has_model(diagnosis) and diagnosis.condition in HARMLESS and scatter > 1 - LEAST_SHARE


@dataclass(frozen=True)
class AnswerWords:
    diagnosis: Diagnosis
    texts: Texts = ENGLISH

    @property
    def preconditions(self) -> list[str]:
        """Sentences that limit all conclusions and therefore come first."""
        moved = [movement_sentence(movement, self.texts) for movement in self.diagnosis.movements]
        commanded = self.texts("finding_only_commanded") if self.diagnosis.only_commanded else ""
        unrepeated = self.unrepeated if self._repeats_decide else ""
        return [sentence for sentence in (*self.contradictions, *moved, commanded, unrepeated) if sentence]

    @property
    def _repeats_decide(self) -> bool:
        return self.diagnosis.next_act is not None and self.diagnosis.next_act.why == "revisit"

    @property
    def unrepeated(self) -> str:
        """Deviations above the usual scatter, if no target was visited twice."""
        um = self.diagnosis.residual.unrepeated_um
        if um is None or is_mostly_scatter(self.diagnosis):
            return ""
        return self.texts("finding_unrepeated", um=micrometres(um))

    @property
    def contradictions(self) -> list[str]:
        return [
            self.texts(
                "finding_contradicted", constant=self.constant_name(made), made=made,
                difference=f"{abs(made.difference):.3g} {made.stated.sign}",
            )
            for made in self.diagnosis.contradictions
        ]  # fmt: skip

    def constant_name(self, made: Contradiction) -> str:
        return self.texts(f"constant_{made.key.rpartition('.')[2]}", names=self.texts("and").join(made.names))

    @property
    def visits(self) -> str:
        """The difference between repeats or between two gauges; empty if it is usual."""
        visits_um, gauges_um = self.diagnosis.residual.visits_um, self.diagnosis.residual.gauges_um
        if visits_um:
            return self.of_places("finding_repeats_differ", um=_length(visits_um))
        return self.texts("finding_gauges_differ", um=_length(gauges_um)) if gauges_um else ""

    def of_places(self, *keys: str, **values: object) -> str:
        """The first text that exists, in its variant for runs of poses or touches, which have no ball and gauges."""
        ends = ("_places", "") if self.diagnosis.train.of_places else ("",)
        return self.texts(*(f"{key}{end}" for key in keys for end in ends), **values)

    @property
    def accuracy(self) -> str:
        accuracy = self.diagnosis.accuracy
        now_um = self._bounded(accuracy.now_um, self.diagnosis.train.u_um)
        model = "error_corrected" if has_model(self.diagnosis) else "error_now"
        return self.texts(model, now=f"{now_um} µm", largest=micrometres(accuracy.now_largest_um))

    def gap_cells(self, gap: Gap) -> dict[str, str]:
        """Errors of a gap in µm, by the text key of the column."""
        diagnosis = self.diagnosis
        errors = {"gap_before": (gap.before_um, gap.u_um)}
        errors |= {"gap_after": (gap.after_um, gap.residual_u_um)} if diagnosis.standing else {}
        errors |= {"gap_calibrated": (gap.calibrated_um, gap.residual_u_um)} if diagnosis.is_modelled else {}
        cells = {key: self._bounded(*error) for key, error in errors.items()}
        return cells | {"noise" if diagnosis.shows_noise else "assumed_noise": error_size(gap.noise_floor_um, 0.0)}

    def error_size(self, um: float, u_um: float | None) -> str:
        """An error in µm with its measured standard uncertainty, or "< u" if it is much smaller."""
        return error_size(um, measured_u(self.diagnosis, u_um))

    def _bounded(self, um: float, u_um: float) -> str:
        return self.error_size(um, u_um).partition(" ± ")[0]

    @property
    def judged(self) -> str:
        accuracy = self.diagnosis.accuracy
        if accuracy.standing is None or accuracy.limit is None:
            return self.texts("accuracy_open")
        judged = self.texts(f"accuracy_{accuracy.standing}", by=self.texts(f"limit_{accuracy.limit}"))
        return self.texts("accuracy_uncorrected", judged=judged) if has_model(self.diagnosis) else judged

    def part_name(self, part: BudgetPart) -> str:
        """Name of a part with the parts that cancel some of it."""
        name, others = self.short_name(part), ", ".join(map(self.short_name, part.shown_together[1:]))
        return self.texts("with_cancelled", part=name, others=others) if others else name

    def describe_parts_alone(self, parts: Sequence[BudgetPart]) -> list[str]:
        return [self.texts("alone", part=self.short_name(part), um=micrometres(part.um, part.u_um)) for part in parts]

    def short_name(self, part: BudgetPart) -> str:
        if named := self.diagnosis.named_of(part):
            return self.noun_with_twins(named.effect, named.twins)
        if part.kind == "effect":
            return name_in_words(part.name)
        return self.texts(f"part_{part.kind}", joint=self.joint(part))

    def size_of(self, part: BudgetPart) -> str:
        """Size of an effect ± standard uncertainty; empty for other parts."""
        named = self.diagnosis.named_of(part)
        return self.size_words(named) if named else ""

    def likely_members(self, part: BudgetPart) -> str:
        """The effects of which one may cause a group of small errors; empty if none is likely."""
        likely = [(member.effect, member.odds) for member in part.members if member.is_dominant]
        if part.kind == "unexplained":  # names that an unknown cause may imitate
            likely = [(named.effect, named.probability) for named in self.diagnosis.effects if named.doubt in IMITATED]
        likely = [(effect, odds) for effect, odds in likely if odds >= LEAST_ODDS][:_MOST_NAMED]
        members = [self.with_odds(effect, odds) for effect, odds in likely]
        is_likely = part.kind != "unexplained" and any(odds >= LIKELY for _, odds in likely)
        key = "likely_members" if is_likely else "possible_members"
        return self.texts(key, members=self.texts("or").join(members)) if members else ""

    def with_odds(self, effect: Effect, odds: float) -> str:
        return f"{self.noun(effect)} ({sure(odds)})"

    def times_usual(self, part: BudgetPart) -> str:
        times = part.times_usual
        if times is None or not math.isfinite(times):
            return ""
        return self.texts("times_usual", times=f"{times:.1f}" if times >= 0.05 else "< 0.1")

    def noun(self, effect: Effect) -> str:
        return self._noun_at(effect, self.joint(effect))

    def _noun_at(self, effect: Effect, joint: str) -> str:
        words = self.texts.nouns.get(name_of(effect), self.texts.nouns.get(effect.effect))
        if words is None:
            return effect.plain(joint)
        fields = effect.model_dump() | {"joint": joint}
        if "order" in fields:  # as a number of teeth
            fields["order"] = whole_order(fields["order"])
        return words.format(**fields)

    def noun_with_twins(self, effect: Effect, twins: Sequence[Effect]) -> str:
        """Name of effects that no reading separates. Constants of parallel axes, of which only the sum is known, have a
        common name.
        """
        every = (effect, *twins)
        axes = [axis for one in every if (axis := getattr(one, "axis", None))]
        is_alike = len({(one.effect, getattr(one, "field", "")) for one in every}) == 1
        if len(axes) < 2 or len(axes) < len(every) or not is_alike:
            return self.texts("or").join(map(self.noun, every))
        joint = self.texts("axes_numbered", axes=", ".join(map(str, sorted(axes))))
        return self._noun_at(effect, joint)

    def size_words(self, named: Named | GroupMember) -> str:
        """Size of an effect; of a deflection with the payload, if the rig file does not state it."""
        robot, payload_kg = self.diagnosis.rig.robot, getattr(named.effect, "payload_kg", 0.0)
        is_small = payload_kg <= _SMALL_PAYLOAD * sum(axis.mass_kg for axis in robot.axes)
        if robot.payload_kg > 0 or is_small:
            return size(named)
        return self.texts("size_with_payload", size=size(named), kg=f"{payload_kg:.2g}")

    def joint(self, effect: object) -> str:
        """Name of the axis of an effect; empty if it has none."""
        axis = getattr(effect, "axis", None)
        return self.texts.axis(self.diagnosis.rig.robot, axis) if axis else ""

    @property
    def already_held(self) -> str:
        """The effects of the rig file, since "nothing found" then means nothing further."""
        nouns = list(dict.fromkeys(map(self.noun, self.diagnosis.rig.effects)))
        return self.texts("already_held", effects=self._listed(nouns)) if nouns else ""

    @property
    def usual_or_faults(self) -> str:
        """Effects of usual size that may be faults; empty if more runs would decide."""
        diagnosis = self.diagnosis
        if diagnosis.condition != "undecided" or diagnosis.runs_to_decide is not None:
            return ""
        sentences = []
        for named in [named for named in diagnosis.effects if fault_rivals(named)][:_MOST_NAMED]:
            faults = [self.with_odds(rival.effect, rival.probability) for rival in fault_rivals(named)]
            share, odds = percent(share_of(diagnosis, named)), sure(named.probability)
            values = {"share": share, "usual": self.noun(named.effect), "odds": odds}
            sentences.append(self.texts("finding_usual_or_fault", **values, faults=self.texts("or").join(faults)))
        return joined(sentences)

    @property
    def condition_sentence(self) -> str:
        """The condition of the arm; named effects have separate sentences."""
        if self.diagnosis.condition == "out_of_range":
            (named,) = self.diagnosis.effects
            limit = min((abs(limit) for limit in size_limits(named.effect) if limit), default=math.inf)
            unit = quantity_of(named.effect, size_field(named.effect), {}).sign
            nouns = self.noun_with_twins(named.effect, named.twins)
            values = {"size": size(named), "limit": f"{limit:.4g} {unit}".rstrip()}
            return self.texts("finding_out_of_range", parameter=nouns, **values)
        unusual = [f"{self.short_name(part)}, {self.times_usual(part)}" for part in unusual_groups(self.diagnosis)]
        larger = self.texts("finding_unusual_group", parts=self._listed(unusual)) if unusual else ""
        return joined([self._condition(), larger])

    def _condition(self) -> str:
        diagnosis, residual, key = self.diagnosis, self.diagnosis.residual, str(self.diagnosis.condition)
        if residual.scatter_um and is_mostly_scatter(diagnosis):
            # of a place, like every error
            return self.texts("finding_scatter", um=_length(math.sqrt(3) * residual.scatter_um))
        if is_complete(diagnosis):
            return self._complete()
        if key == "undecided":
            return self._undecided()
        if key == "outside_library":
            key = "unexplained_there" if residual.at_new_places else "unexplained"
        elif key in HARMLESS and diagnosis.movements:
            key = "nothing_else"
        elif key == "uncalibrated" and any(part.index is not None for part in large_parts(diagnosis)):
            key = "nothing_unusual"
        return self.texts(f"finding_{key}", um=micrometres(residual.um))

    def _complete(self) -> str:
        """The sentence on a complete model: at how many places repeated readings still differ."""
        diagnosis = self.diagnosis
        if not (diagnosis.repeated and len(diagnosis.runs) > 1):
            return self.texts("finding_model_sufficient")
        if not diagnosis.where:
            return self.texts("finding_model_complete")
        largest = micrometres(max(place.rms_um for place in diagnosis.where))
        return self.texts.counted("finding_nearly_complete", len(diagnosis.where), largest=largest)

    def _undecided(self) -> str:
        """Why no part can be confirmed: the number of runs, an open question, or an imitation."""
        doubts = {named.doubt for named in self.diagnosis.effects}
        if self.diagnosis.runs_to_decide is None:
            if self.unrepeated:
                unrepeated = "unrepeated" if self._repeats_decide else "unrepeated_later"
                return self.texts(f"finding_undecided_{'unexplained' if 'unexplained' in doubts else unrepeated}")
            for doubt in IMITATED[::-1]:  # commanded angles first
                if doubt in doubts:
                    return self.texts(f"finding_undecided_{doubt}")
        if not (imitated := [named for named in self.diagnosis.effects if named.doubt in IMITATED]):
            return self.texts("finding_undecided")
        most = max(imitated, key=lambda named: named.contribution_um)
        why = self.texts(f"doubt_{most.doubt}")
        return self.texts("finding_not_confirmed", name=capital(self.noun(most.effect)), why=why)

    @property
    def unexplained_too(self) -> str:
        """The error of unknown cause; empty if another sentence states it."""
        residual, condition = self.diagnosis.residual, self.diagnosis.condition
        if self.unrepeated:
            return "" if self._repeats_decide else self.unrepeated
        if not residual.is_material or condition in ("outside_library", "out_of_range"):
            return ""
        where = "_there" if residual.at_new_places else ""
        return self.texts(f"finding_unexplained{where}", um=micrometres(residual.um))

    @property
    def follows(self) -> str:
        """The quantity that the unexplained error follows; empty if none was searched."""
        residual = self.diagnosis.residual
        if not residual.follows or self.diagnosis.condition != "outside_library":
            return ""
        if (followed := residual.likeliest) is None:
            return self.texts("finding_follows_none")
        subject = self.texts(f"follows_{followed.what}", joint=self.joint(followed))
        return self.texts("finding_follows", subject=subject, share=percent(followed.share))

    def _listed(self, phrases: Sequence[str]) -> str:
        more = len(phrases) - _MOST_NAMED
        return joined([*phrases[:_MOST_NAMED], self.texts("and_more", count=more) if more > 0 else ""], "; ")

    def likeliest_first(self, named: Named) -> list[Named | Rival]:
        return sorted([named, *likely_rivals(named)], key=lambda cause: -cause.probability)


def share_of(diagnosis: Diagnosis, named: Named) -> float:
    """Share of the error caused by an effect, also if the budget counts it with another part."""
    part = part_of(diagnosis, named)
    return min(part.share if part else (named.contribution_um / diagnosis.accuracy.now_um) ** 2, 1.0)


def _length(um: float) -> str:
    return f"{1e-3 * um:.2f} mm" if um >= 100 else micrometres(um)


def judged_gap(diagnosis: Diagnosis) -> Gap:
    return {"unseen": diagnosis.unseen, "held_out": diagnosis.held_out}.get(diagnosis.accuracy.place) or diagnosis.train


def part_of(diagnosis: Diagnosis, named: Named) -> BudgetPart | None:
    return next((part for part in diagnosis.budget if diagnosis.named_of(part) is named), None)
