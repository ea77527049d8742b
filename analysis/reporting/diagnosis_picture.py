"""The picture of a diagnosis: circles, hemispheres, how the gap shrinks part by part, what cannot be distinguished."""

from __future__ import annotations

import textwrap
from collections.abc import Callable

from matplotlib.figure import Figure, SubFigure

from analysis.inference.disagreement import Disagreement
from analysis.inference.result import Diagnosis
from analysis.reporting.act_words import ActWords
from analysis.reporting.answer_words import AnswerWords
from analysis.reporting.diagnosis_curves import draw_circles, strands_of
from analysis.reporting.diagnosis_maps import draw_map, drawn_maps
from analysis.reporting.sheet import Sheet
from analysis.reporting.stairs import Stairs, stairs_of, stairs_of_model
from analysis.reporting.stairs_picture import draw_stairs

_WIDTH = 11.0
_MOST_MAPS = 3
_MOST_GROUPS = 5
_COLUMNS, _TEXT_COLUMNS = 92, 165
"""Letters a line holds, of the title and of the text below."""
_KEY = (
    "Distance: mean of the gauges; angle: their difference g2 − g1. Dotted: the joint of that number turns back. "
    "Shaded: where they disagree, unless it is the whole lap."
)


_Part = tuple[float, Callable[[SubFigure], None]]
"""A part of a sheet: its height in inches, and what draws it."""


def picture(diagnosis: Diagnosis) -> Figure:
    """Everything on one sheet, as high as it needs."""
    parts, quiet = _parts(diagnosis, stairs_of(diagnosis), diagnosis.train.noise_floor_um)
    answer, acts = AnswerWords(diagnosis), ActWords(diagnosis)
    lines = [f"{answer.accuracy} {answer.judged}", *([f"Next: {acts.next}"] if acts.next else [])]
    lines += [f"These tests cannot distinguish: {' or '.join(group)}" for group in diagnosis.groups[:_MOST_GROUPS]]
    others = len(diagnosis.groups) - _MOST_GROUPS
    lines += [f"and {others} more groups"] * (others > 0)
    lines += _not_shown(quiet)
    lines += [_KEY] * bool(diagnosis.curves)
    words = [line for paragraph in lines for line in textwrap.wrap(paragraph, _TEXT_COLUMNS)]
    parts.append((0.2 + 0.17 * len(words), lambda sheet: _draw_words(sheet, words)))
    title = textwrap.wrap(AnswerWords(diagnosis).headline, _COLUMNS)
    return _sheet([*title, diagnosis.rig.name], parts)


def disagreement_picture(disagreement: Disagreement) -> Figure:
    """Where the model of a rig file and readings disagree, and how the gap shrinks with its effects."""
    parts, quiet = _parts(disagreement, stairs_of_model(disagreement), disagreement.floor_um)
    words = [*_not_shown(quiet), *([_KEY] if disagreement.curves else [])]
    parts.append((0.2 + 0.17 * len(words), lambda sheet: _draw_words(sheet, words)))
    return _sheet([f"Where model and readings disagree · {disagreement.rig.name}"], parts)


def _parts(residuals: Diagnosis | Disagreement, stairs: Stairs | None, floor_um: float) -> tuple[list[_Part], int]:
    """The circles, the maps and the stairs; and how many circles and maps are left out."""
    effects = stairs is not None
    strands, quiet = strands_of(residuals)
    parts: list[_Part] = []
    if strands:
        height = (2.5 if effects else 2.0) * len(strands)
        parts.append((height, lambda sheet: draw_circles(sheet, strands, effects=effects)))
    maps = drawn_maps(residuals)
    for target_map in maps[:_MOST_MAPS]:
        parts.append((3.6, lambda sheet, target_map=target_map: draw_map(sheet, target_map, effects=effects)))  # type: ignore[misc]
    if stairs:
        parts.append((0.9 + 0.24 * len(stairs.steps), lambda sheet: draw_stairs(sheet, stairs, floor_um)))
    return parts, quiet + max(0, len(maps) - _MOST_MAPS)


def _sheet(title: list[str], parts: list[_Part]) -> Figure:
    heights = [height for height, _ in parts]
    figure = Sheet(_WIDTH, sum(heights) + 0.2 + 0.2 * len(title))
    figure.suptitle("\n".join(title), fontsize=11)
    rows = figure.subfigures(len(parts), 1, height_ratios=heights, squeeze=False)[:, 0]
    for sheet, (_, draw) in zip(rows, parts, strict=True):
        draw(sheet)
    return figure


def _not_shown(quiet: int) -> list[str]:
    return [f"Not shown: {quiet} more, which disagree less."] * bool(quiet)


def _draw_words(sheet: SubFigure, lines: list[str]) -> None:
    axes = sheet.subplots()
    axes.set_axis_off()
    axes.text(0.0, 1.0, "\n".join(lines), transform=axes.transAxes, va="top", fontsize=8, color="#444444")
