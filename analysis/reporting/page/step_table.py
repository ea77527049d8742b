"""The staircase of the gap as rows of a table with a bar in each."""

from __future__ import annotations

from dataclasses import dataclass

from analysis.inference.result import Diagnosis
from analysis.reporting.stairs import left_words, stairs_of
from analysis.reporting.texts import Texts


@dataclass(frozen=True)
class StepRow:
    """A step: its name, what is left at each place in words, the width of each place's bar in percent of the column,
    and the step in a sentence, which a screen reader says."""

    name: str
    left: tuple[str, ...]
    widths: tuple[float, ...]
    sentence: str


@dataclass(frozen=True)
class StepTable:
    """The rows, and the headings of the places of their figures."""

    places: tuple[str, ...]
    rows: tuple[StepRow, ...]


def step_table(diagnosis: Diagnosis, texts: Texts) -> StepTable | None:
    """The table of the staircase of a diagnosis; None where it has none."""
    stairs = stairs_of(diagnosis, texts)
    if stairs is None:
        return None
    rows = []
    for number, step in enumerate(stairs.steps):
        widths = tuple(100 * residue.um / stairs.largest_um for residue in step.left)
        sentence = texts("step_now", number=number, count=len(stairs.steps) - 1, name=step.name)
        rows.append(StepRow(step.name, tuple(map(left_words, step.left)), widths, sentence))
    return StepTable(tuple(texts(f"runs_{place}") for place in stairs.places), tuple(rows))
