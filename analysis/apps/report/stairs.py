"""The staircase of the gap in words: the part that each step adds, and the residual after it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from analysis.apps.report.answer_words import AnswerWords
from analysis.apps.report.diagnosis_words import error_size, has_measured_noise, plain
from analysis.apps.report.texts import Texts, texts_of
from analysis.diagnosis.judge.comparison import LocatedResidual
from analysis.diagnosis.judge.residuals import ModelResidual, Staircase
from analysis.diagnosis.judge.result import Diagnosis


@dataclass(frozen=True)
class Stairs:
    places: tuple[str, ...]
    """Text keys of the places, the runs used first."""
    names: tuple[str, ...]
    """The initial model, then the part that each step adds."""
    left: tuple[tuple[ModelResidual, ...], ...]
    """Residuals of each step by place."""

    def step_names(self, texts: Texts) -> list[str]:
        return [self.names[0], *(texts("step_with", part=part) for part in self.names[1:])]

    @property
    def largest_um(self) -> float:
        return max(1e-9, *(residual.um for step in self.left for residual in step))


def stairs_of(diagnosis: Diagnosis, texts: Texts | None = None) -> Stairs | None:
    if diagnosis.staircase is None:
        return None
    texts = texts or texts_of("en")
    words, names = AnswerWords(diagnosis, texts), [str(texts("step_first"))]
    for step in diagnosis.staircase.steps[1:]:
        single = words.part_name(diagnosis.budget[step.parts[0]]) if len(step.parts) == 1 else ""
        names.append(single or texts.counted("smaller_parts", len(step.parts)))
    return _stairs(diagnosis.staircase, names, has_u=has_measured_noise(diagnosis))


def stairs_of_model(residual: LocatedResidual) -> Stairs | None:
    if residual.staircase is None:
        return None
    texts, rig = texts_of("en"), residual.rig
    parts = [*(plain(rig, effect) for effect in rig.effects), texts("step_calibration")]
    added = [parts[step.parts[0]] for step in residual.staircase.steps[1:]]
    return _stairs(residual.staircase, [texts("step_bare"), *added], has_u=True)


def _stairs(staircase: Staircase, names: Sequence[str], *, has_u: bool) -> Stairs:
    left = [[residual for residual in (step.used, step.held_out, step.unseen) if residual] for step in staircase.steps]
    shown = (tuple(residual if has_u else replace(residual, u_um=0.0) for residual in step) for step in left)
    return Stairs(staircase.places, tuple(names), tuple(shown))


def residual_words(residual: ModelResidual) -> str:
    return error_size(residual.um, residual.u_um)


def step_sentences(stairs: Stairs, texts: Texts) -> list[str]:
    first, *parts = stairs.names
    later = [texts("step_now", number=number, count=len(parts), part=part) for number, part in enumerate(parts, 1)]
    return [texts("step_start", count=len(parts), name=first), *later]
