"""The staircase of the gap, as text and on the screen: name and residual of each step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from analysis.apps.report.answer_words import AnswerWords
from analysis.apps.report.diagnosis_words import error_size, has_measured_noise, plain
from analysis.apps.report.texts import Texts, texts_of
from analysis.diagnosis.judge.comparison import Disagreement
from analysis.diagnosis.judge.result import Diagnosis
from analysis.diagnosis.judge.staircase import ModelResidual, Staircase


@dataclass(frozen=True)
class Stair:
    """A step by name, with the part that it adds (empty for the first step) and the residual at each place."""

    name: str
    left: tuple[ModelResidual, ...]
    part: str = ""


@dataclass(frozen=True)
class Stairs:
    """All steps. `places` are the text keys of the places, the runs used first."""

    places: tuple[str, ...]
    steps: tuple[Stair, ...]

    @property
    def largest_um(self) -> float:
        return max(1e-9, *(residue.um for step in self.steps for residue in step.left))


def stairs_of(diagnosis: Diagnosis, texts: Texts | None = None) -> Stairs | None:
    """Return the staircase of a diagnosis; None if it has none."""
    if diagnosis.staircase is None:
        return None
    texts = texts or texts_of("en")
    words = AnswerWords(diagnosis, texts)
    parts = []
    for step in diagnosis.staircase.steps[1:]:
        count = len(step.parts)
        single = words.part_name(diagnosis.budget[step.parts[0]]) if count == 1 else ""
        parts.append(single or texts.counted("smaller_parts", count))
    stairs = _name_stairs(diagnosis.staircase, texts("step_first"), parts, texts)
    if has_measured_noise(diagnosis):
        return stairs
    bare = [replace(step, left=tuple(replace(residue, u_um=0.0) for residue in step.left)) for step in stairs.steps]
    return replace(stairs, steps=tuple(bare))


def stairs_of_model(disagreement: Disagreement) -> Stairs | None:
    """Return the staircase of a rig file's effects and calibration; None if the model has none."""
    if disagreement.staircase is None:
        return None
    texts, rig = texts_of("en"), disagreement.rig
    parts = [*(plain(rig, effect) for effect in rig.effects), texts("step_calibration")]
    added = [parts[step.parts[0]] for step in disagreement.staircase.steps[1:]]
    return _name_stairs(disagreement.staircase, texts("step_bare"), added, texts)


def _name_stairs(staircase: Staircase, first: str, parts: Sequence[str], texts: Texts) -> Stairs:
    lefts = [tuple(filter(None, (step.used, step.held_out, step.unseen))) for step in staircase.steps]
    names = [first, *(texts("step_with", part=part) for part in parts)]
    return Stairs(staircase.places, tuple(map(Stair, names, lefts, ["", *parts])))


def residual_words(residue: ModelResidual) -> str:
    """Return a residual ± standard uncertainty in µm, as in the tiles."""
    return error_size(residue.um, residue.u_um)


def step_sentences(diagnosis: Diagnosis, texts: Texts) -> list[str]:
    """Return a sentence for each step, for screen readers and the slider of the page."""
    stairs = stairs_of(diagnosis, texts)
    steps = stairs.steps if stairs else ()
    return [
        texts("step_now", number=number, count=len(steps) - 1, part=step.part)
        if step.part
        else texts("step_start", count=len(steps) - 1, name=step.name)
        for number, step in enumerate(steps)
    ]
