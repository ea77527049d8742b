"""The picture of a diagnosis: the charts of the page, the staircase of the gap, and the first sentences."""

from __future__ import annotations

import textwrap

import numpy as np
from matplotlib.figure import Figure, SubFigure

from analysis.apps.report.chart import Part, sheet_of
from analysis.apps.report.diagnosis_answer import Stairs, residual_words, stairs_of, stairs_of_model
from analysis.apps.report.model_charts import residual_charts
from analysis.apps.report.summary_words import summarise
from analysis.apps.report.texts import ENGLISH
from analysis.diagnosis.judge.comparison import LocatedResidual
from analysis.diagnosis.judge.result import Diagnosis
from rigs.effect_names import name_in_words

_MOST_GROUPS = 5
_COLUMNS, _TEXT_COLUMNS, _NAME_COLUMNS = 92, 165, 40
"""Characters per line of title, text below, and names of steps."""
_BAR = 0.27
"""Height of a bar; three places share the distance of two steps."""


def picture(diagnosis: Diagnosis, *, in_session: bool = False) -> Figure:
    """The diagnosis on one sheet. in_session: without the advice to correct, which the session does itself."""
    summary = summarise(diagnosis)
    error, is_next = summary.error, summary.next and not (in_session and diagnosis.acts[0].kind == "load")
    lines = [*summary.unknowns, f"{error.title}: {error.words}. {error.basis} {error.standing}"]
    lines += [f"Do next: {summary.next} {summary.command}".rstrip()] if is_next else []
    groups = [" or ".join(map(name_in_words, group)) for group in diagnosis.groups]
    lines += [f"These tests cannot separate {group}." for group in groups[:_MOST_GROUPS]]
    lines += [f"and {len(groups) - _MOST_GROUPS} more groups"] * (len(groups) > _MOST_GROUPS)
    title = textwrap.wrap(f"{summary.badge}: {summary.headline}", _COLUMNS)
    return _sheet([*title, diagnosis.rig.name], diagnosis, stairs_of(diagnosis), lines)


def disagreement_picture(residual: LocatedResidual) -> Figure:
    title = f"Where model and readings disagree · {residual.rig.name}"
    return _sheet([title], residual, stairs_of_model(residual), [])


def _sheet(title: list[str], residuals: Diagnosis | LocatedResidual, stairs: Stairs | None, lines: list[str]) -> Figure:
    wrapped = [line for paragraph in lines for line in textwrap.wrap(paragraph, _TEXT_COLUMNS)]

    def draw_words(sheet: SubFigure) -> None:
        axes = sheet.subplots()
        axes.set_axis_off()
        axes.text(0.0, 1.0, "\n".join(wrapped), transform=axes.transAxes, va="top", fontsize=8, color="#444444")

    parts = [_stairs(stairs)] if stairs else []
    parts += [(0.2 + 0.17 * len(wrapped), draw_words)] if wrapped else []
    return sheet_of(title, residual_charts(residuals, stairs, ENGLISH), parts, 11.0)


def _stairs(stairs: Stairs) -> Part:
    def draw(sheet: SubFigure) -> None:
        axes = sheet.subplots()
        for k, (key, left) in enumerate(zip(stairs.places, zip(*stairs.left, strict=True), strict=True)):
            um, u_um = zip(*((residual.um, residual.u_um) for residual in left), strict=True)
            rows, name = np.arange(len(left)) + k * _BAR, ENGLISH(f"runs_{key}")
            bars = axes.barh(rows, um, _BAR, xerr=u_um, label=name, error_kw={"elinewidth": 0.7})
            axes.bar_label(bars, list(map(residual_words, left)), padding=5, fontsize=6.5)
        # The name of a part with many cancelling parts takes three lines, which would squeeze the bars.
        wrapped = [
            textwrap.wrap(name, _NAME_COLUMNS, max_lines=2, placeholder=" …") for name in stairs.step_names(ENGLISH)
        ]
        axes.set_yticks(range(len(wrapped)), list(map("\n".join, wrapped)), fontsize=8)
        axes.invert_yaxis()
        axes.margins(x=0.12)
        axes.set_xlim(left=0)
        axes.set_xlabel("left of the error, rms / µm", fontsize=8)
        axes.spines[["top", "right"]].set_visible(False)
        sheet.legend(loc="outside lower center", ncols=3, fontsize=8, frameon=False)

    return 1.1 + 0.28 * len(stairs.left), draw
