"""The picture of a diagnosis: circles, hemispheres, how much each effect explains, what cannot be distinguished."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from analysis.inference.result import Diagnosis
from analysis.reporting.act_words import ActWords
from analysis.reporting.answer_words import AnswerWords
from analysis.reporting.diagnosis_curves import GREY, MEASURED, MODEL, draw_circles, strands_of
from analysis.reporting.diagnosis_maps import draw_map
from analysis.reporting.sheet import Sheet

_WIDTH = 11.0
_MOST_MAPS = 3
_MOST_GROUPS = 5
_COLUMNS, _TEXT_COLUMNS = 92, 165
"""Letters a line holds, of the title and of the text below."""
_KEY = (
    "Distance: mean of the gauges; angle: their difference g2 − g1. Dotted: the joint of that number turns back. "
    "Shaded: where they disagree, unless it is the whole lap."
)


def picture(found: Diagnosis) -> Figure:
    """Everything on one sheet, as high as it needs."""
    effects = bool(found.standing)
    strands, quiet = strands_of(found)
    parts: list[tuple[float, Callable[[SubFigure], None]]] = []
    if strands:
        height = (2.5 if effects else 2.0) * len(strands)
        parts.append((height, lambda sheet: draw_circles(sheet, strands, effects=effects)))
    for one in found.maps[:_MOST_MAPS]:
        parts.append((3.6, lambda sheet, one=one: draw_map(sheet, one, effects=effects)))  # type: ignore[misc]
    quiet += max(0, len(found.maps) - _MOST_MAPS)
    bars = _bars(found)
    if bars:
        floor = found.train.noise_floor_um
        parts.append((0.9 + 0.24 * max(len(bars), 2), lambda sheet: _draw_bars(sheet, bars, floor)))
    words = _words(found, quiet)
    parts.append((0.2 + 0.17 * len(words), lambda sheet: _draw_words(sheet, words)))
    heights = [height for height, _ in parts]
    title = textwrap.wrap(AnswerWords(found).headline, _COLUMNS)
    figure = Sheet(_WIDTH, sum(heights) + 0.4 + 0.2 * len(title))
    figure.suptitle("\n".join([*title, found.rig.name]), fontsize=11)
    for sheet, (_, draw) in zip(
        figure.subfigures(len(parts), 1, height_ratios=heights, squeeze=False)[:, 0], parts, strict=True
    ):
        draw(sheet)
    return figure


def _bars(found: Diagnosis) -> list[tuple[str, float, str]]:
    """Name, error in µm and ink: now, with each fault alone removed, and calibrated; those known."""
    words = AnswerWords(found)
    bars = [("now", found.train.before_um, MEASURED)]
    bars += [(f"{words.noun(one.effect)} alone removed", one.alone_um, MODEL) for one in found.standing]
    bars.append(("calibrated", found.train.calibrated_um, GREY))
    return [bar for bar in bars if np.isfinite(bar[1])]


def _draw_bars(sheet: SubFigure, bars: Sequence[tuple[str, float, str]], floor_um: float) -> None:
    axes: Axes = sheet.subplots()
    place = np.arange(len(bars))[::-1]
    axes.barh(place, [value for _, value, _ in bars], color=[ink for *_, ink in bars], height=0.62)
    for k, (_, value, _) in zip(place, bars, strict=True):
        axes.annotate(f"{value:.1f}", (value, k), xytext=(4, 0), textcoords="offset points", va="center", fontsize=8)
    axes.set_yticks(place, [name for name, *_ in bars], fontsize=8)
    if np.isfinite(floor_um):
        axes.axvline(floor_um, color=GREY, ls="--", lw=1)
        axes.annotate(
            f"noise floor {floor_um:.1f}", (floor_um, 1.0), xycoords=("data", "axes fraction"),
            xytext=(3, 1), textcoords="offset points", fontsize=7.5, color=GREY,
        )  # fmt: skip
    axes.set_ylim(-0.6, max(len(bars), 2) - 0.4)
    axes.set_xlim(0, 1.12 * float(np.nanmax([floor_um, *(value for _, value, _ in bars)])))
    axes.set_xlabel("error on the runs used, rms / µm", fontsize=8)
    axes.tick_params(axis="x", labelsize=7.5)
    axes.spines[["top", "right"]].set_visible(False)


def _words(found: Diagnosis, quiet: int) -> list[str]:
    answer, acts = AnswerWords(found), ActWords(found)
    lines = [f"{answer.accuracy} {answer.judged}", *([f"Next: {acts.next}"] if acts.next else [])]
    lines += [f"These tests cannot distinguish: {' or '.join(group)}" for group in found.groups[:_MOST_GROUPS]]
    more = len(found.groups) - _MOST_GROUPS
    lines += [f"and {more} more groups"] * (more > 0)
    lines += [f"Not shown: {quiet} more, which disagree less."] * bool(quiet)
    lines += [_KEY] * bool(found.curves)
    return [line for one in lines for line in textwrap.wrap(one, _TEXT_COLUMNS)]


def _draw_words(sheet: SubFigure, lines: list[str]) -> None:
    axes = sheet.subplots()
    axes.set_axis_off()
    axes.text(0.0, 1.0, "\n".join(lines), transform=axes.transAxes, va="top", fontsize=8, color="#444444")
