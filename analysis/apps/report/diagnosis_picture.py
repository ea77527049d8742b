"""The picture of a diagnosis: circles, hemispheres, the staircase of the gap, and indistinguishable causes."""

from __future__ import annotations

import textwrap
from dataclasses import replace
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from analysis.apps.report.chart import Chart
from analysis.apps.report.model_charts import MOST_MAPS, maps_of, strand_charts, target_chart
from analysis.apps.report.run_pictures import draw_hemisphere
from analysis.apps.report.stairs import Stairs, residual_words, stairs_of, stairs_of_model
from analysis.apps.report.still_chart import Part, Sheet, part_of
from analysis.apps.report.summary_words import summarise
from analysis.apps.report.texts import texts_of
from analysis.diagnosis.judge.comparison import Disagreement
from analysis.diagnosis.judge.residuals import Map
from analysis.diagnosis.judge.result import Diagnosis
from analysis.robot.kinematics.arm import Array
from analysis.runs.noise.readings import rms
from rigs.effect_names import name_in_words

_WIDTH = 11.0
_MOST_GROUPS = 5
_COLUMNS, _TEXT_COLUMNS = 92, 165
"""Characters per line of the title and of the text below."""
_NAME_COLUMNS = 40
"""Characters per line of a step name."""
_INKS = {"used": "#1f5fa8", "held_out": "#1c1c1c", "unseen": "#d95f02"}
_SYMBOLS = {"held_out": "s", "unseen": "D"}
_GREY = "#777777"


def picture(diagnosis: Diagnosis, *, in_session: bool = False) -> Figure:
    """Draw the diagnosis on one sheet, as high as necessary.

    in_session: leave out the recommendation to load corrected programs. The session itself corrects the programs and
    states the expected error.
    """
    parts, quiet = _parts(diagnosis, stairs_of(diagnosis), diagnosis.train.noise_floor_um)
    summary = summarise(diagnosis)
    error, is_next = summary.error, summary.next and not (in_session and diagnosis.acts[0].kind == "load")
    lines = [*summary.unknowns, f"{error.title}: {error.words}. {error.basis} {error.standing}"]
    lines += [f"Do next: {summary.next} {summary.command}".rstrip()] if is_next else []
    groups = diagnosis.groups[:_MOST_GROUPS]
    lines += [f"These tests cannot separate {'; '.join(map(name_in_words, group))}." for group in groups]
    others = len(diagnosis.groups) - _MOST_GROUPS
    lines += [f"and {others} more groups"] * (others > 0)
    lines += _not_shown(quiet)
    words = [line for paragraph in lines for line in textwrap.wrap(paragraph, _TEXT_COLUMNS)]
    parts.append((0.2 + 0.17 * len(words), lambda sheet: _draw_words(sheet, words)))
    title = textwrap.wrap(f"{summary.badge}: {summary.headline}", _COLUMNS)
    return Sheet.of_parts([*title, diagnosis.rig.name], parts, _WIDTH)


def disagreement_picture(disagreement: Disagreement) -> Figure:
    """Draw the disagreement of a rig file's model and the readings, and the staircase of its effects."""
    parts, quiet = _parts(disagreement, stairs_of_model(disagreement), disagreement.floor_um)
    words = _not_shown(quiet)
    parts.append((0.2 + 0.17 * len(words), lambda sheet: _draw_words(sheet, words)))
    return Sheet.of_parts([f"Where model and readings disagree · {disagreement.rig.name}"], parts, _WIDTH)


def _parts(residuals: Diagnosis | Disagreement, stairs: Stairs | None, floor_um: float) -> tuple[list[Part], int]:
    """Return the circles, the targets and the staircase, and the number of omitted circles and target tests."""
    texts = texts_of("en")
    charts, quiet = strand_charts(residuals, texts)
    charts[1:] = [replace(chart, caption="") for chart in charts[1:]]  # same caption for all
    parts, maps = [part_of(chart, _closes(chart)) for chart in charts], maps_of(residuals)
    for target_map, steps_um in maps[:MOST_MAPS]:
        if np.isfinite(target_map.polar_deg).all():
            parts.append((3.6, partial(_draw_map, target_map, steps_um)))
        else:
            chart = target_chart(target_map, steps_um, texts)
            parts.append(part_of(chart, _closes(chart)))
    if stairs:
        parts.append((0.9 + 0.28 * len(stairs.steps), partial(_draw_stairs, stairs, floor_um)))
    return parts, quiet + max(0, len(maps) - MOST_MAPS)


def _closes(chart: Chart) -> str:
    """Return the rms of the first residual and, if the chart has steps, the rms of the last."""
    first, last = chart.lines[0], chart.lines[-1]
    after = f" → {rms(last.y):.1f}" if chart.steps else ""
    return f": residual {rms(first.y):.1f}{after} µm rms"


def _draw_map(target_map: Map, steps_um: Array, sheet: SubFigure) -> None:
    """Draw the residuals on the hemisphere before and after all parts, with a common colour scale."""
    every = [("before", steps_um[0]), *([("after", steps_um[-1])] if len(steps_um) > 1 else [])]
    part = sheet if len(every) > 1 else sheet.subfigures(1, 3, width_ratios=(1, 2.2, 1), squeeze=False)[0, 1]
    panels = part.subplots(1, len(every), squeeze=False)[0]
    for axes, (when, values) in zip(panels, every, strict=True):
        dots = draw_hemisphere(axes, target_map.polar_deg, target_map.azimuth_deg, values, target_map.target)
        dots.set_clim(-float(np.abs(steps_um[0]).max()), float(np.abs(steps_um[0]).max()))
        axes.set_title(f"{target_map.test}, residual {when}: rms {rms(values):.1f} µm", fontsize=9)
    part.colorbar(dots, ax=list(panels), label="residual / µm", shrink=0.8)


def _not_shown(quiet: int) -> list[str]:
    return [f"Not shown: {quiet} more, which disagree less."] * bool(quiet)


def _draw_words(sheet: SubFigure, lines: list[str]) -> None:
    axes = sheet.subplots()
    axes.set_axis_off()
    axes.text(0.0, 1.0, "\n".join(lines), transform=axes.transAxes, va="top", fontsize=8, color="#444444")


def _draw_stairs(stairs: Stairs, floor_um: float, sheet: SubFigure) -> None:
    """Draw a bar for the residual of each step on the runs used, and a mark for each other place."""
    axes: Axes = sheet.subplots()
    place = np.arange(len(stairs.steps))[::-1]
    texts = texts_of("en")
    for k, key in enumerate(stairs.places):
        um, u_um = (np.array([getattr(step.left[k], of) for step in stairs.steps]) for of in ("um", "u_um"))
        if k == 0:
            axes.barh(place, um, color=_INKS[key], height=0.62, label=texts(f"runs_{key}"))
        else:
            axes.plot(
                um, place, ls="", marker=_SYMBOLS[key], ms=5, color=_INKS[key], mec="white", mew=0.6,
                label=texts(f"runs_{key}"),
            )  # fmt: skip
        axes.errorbar(um, place, xerr=u_um, fmt="none", ecolor="black", elinewidth=0.7)
    for y, step in zip(place, stairs.steps, strict=True):
        at = (max(residue.um + residue.u_um for residue in step.left), y)
        axes.annotate(
            " · ".join(map(residual_words, step.left)), at, (5, 0), textcoords="offset points", va="center", fontsize=8
        )
    # The name of a part with many cancelling parts takes three lines, which would squeeze the bars.
    names = [textwrap.wrap(step.name, _NAME_COLUMNS, max_lines=2, placeholder=" …") for step in stairs.steps]
    axes.set_yticks(place, list(map("\n".join, names)), fontsize=8)
    if np.isfinite(floor_um):
        axes.axvline(floor_um, color=_GREY, ls="--", lw=1, label=f"noise floor {floor_um:.1f}")
    axes.set_ylim(-0.6, len(stairs.steps) - 0.4)
    axes.set_xlim(
        0, (1.04 + 0.12 * len(stairs.places)) * max(stairs.largest_um, floor_um if np.isfinite(floor_um) else 0.0)
    )
    axes.set_xlabel("left of the error, rms / µm", fontsize=8)
    axes.tick_params(axis="x", labelsize=7.5)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=7.5, loc="lower right", frameon=False)
