"""Pictures of the model: measured beside simulated for each test, and before and after the diagnosis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.inference.compare import Compared, Comparison
from analysis.inference.result import Diagnosis, Map
from analysis.kinematics.arm import Array
from analysis.measures.repeatability import SIDES, RepeatabilityResult
from analysis.measures.results import Result
from analysis.reporting.diagnosis_curves import Strand, strands_of
from analysis.reporting.diagnosis_words import whole_lap
from analysis.reporting.page.chart import Chart, Line, marks_of, stretches
from analysis.reporting.page.report import Report
from analysis.reporting.texts import Texts

_MOST_MAPS = 3
_ARROWS = {"out": "↓", "in": "↑"}
"""Sides of approach as ISO 230-2 marks them in R↓ and R↑."""
_IN_PICTURE = {"deg": ("°", 1.0), "mm": ("µm", 1e3)}
"""Unit and factor in which a compared curve is drawn."""


def simulated_charts(report: Report, group: Sequence[Result], texts: Texts) -> list[Chart]:
    """Measured and simulated error of a group of runs, a picture for each direction; repeated runs as their mean."""
    before, after = _of_group(report.simulated, group), _of_group(report.corrected, group)
    charts, ticks = [], _ticks(group[0])
    for title in dict.fromkeys(one.result.title for one in before):
        x, measured, simulated = _means(before, title)
        unit, factor = _IN_PICTURE[before[0].unit]
        lines = [Line(texts("measured"), "measured", x, factor * measured, points=before[0].unit == "mm")]
        lines.append(Line(texts("simulated"), "model", x, factor * simulated, points=before[0].unit == "mm"))
        if after:
            with_effects = factor * _means(after, title)[2]
            name = texts("simulated_with")
            lines.append(Line(name, "after", x, with_effects, points=before[0].unit == "mm"))
        straight = before[0].unit == "deg"
        x_label = (
            texts("circle_angle") if straight else texts("target" if group[0].test == "radial" else "target_and_side")
        )
        chart_title, caption = texts("chart_simulated", what=title), texts("caption_simulated")
        y_label = f"{texts('error')} / {unit}"
        frame = "straight" if straight else "targets"
        charts.append(Chart(chart_title, caption, frame, x_label, y_label, unit, tuple(lines), ticks=ticks))  # type: ignore[arg-type]
    return charts


def _ticks(result: Result) -> tuple[tuple[float, str], ...]:
    """The names of the places of a repeatability run: each target from outside and from inside."""
    if not isinstance(result.found, RepeatabilityResult):
        return ()
    names = [f"{target} {_ARROWS[side]}" for target in result.found.targets for side in SIDES]
    return tuple((float(place), name) for place, name in enumerate(names))


def _of_group(compared: Compared | None, group: Sequence[Result]) -> list[Comparison]:
    """The comparisons of the runs of a group."""
    paths = {result.measured.path for result in group}
    return [one for one in compared.runs if one.result.measured.path in paths] if compared else []


def _means(runs: Sequence[Comparison], title: str) -> tuple[Array, Array, Array]:
    """Positions (n,), measured and simulated curve (n,): the mean over the runs that have the places of the first."""
    own = [one for one in runs if one.result.title == title]
    alike = [one for one in own if np.array_equal(one.x, own[0].x)]
    measured = np.mean([one.measured_curve for one in alike], axis=0)
    simulated = np.mean([one.simulated_curve for one in alike], axis=0)
    return own[0].x, measured, simulated


def diagnosis_charts(found: Diagnosis, texts: Texts) -> list[Chart]:
    """The gap between readings and model, before the effects and after: along the circles, and at targets."""
    strands, _ = strands_of(found)
    effects = bool(found.standing)
    circles = [_of_circle(strand, texts, effects=effects) for strand in strands]
    return [*circles, *(_of_targets(one, texts, effects=effects) for one in found.maps[:_MOST_MAPS])]


def _of_circle(strand: Strand, texts: Texts, *, effects: bool) -> Chart:
    lines = [Line(texts("gap_before"), "measured", strand.phi_deg, strand.before_um)]
    lines += [Line(texts("gap_after"), "after", strand.phi_deg, strand.after_um)] if effects else []
    marks = marks_of(strand.curve.turns)
    shaded = stretches([(place.from_deg, place.to_deg) for place in strand.places if not whole_lap(place)])
    return Chart(
        texts("chart_gap", what=strand.title), texts("caption_gap"), "straight", texts("circle_angle"),
        f"{texts('gap')} / µm", "µm", tuple(lines), marks, shaded,
    )  # fmt: skip


def _of_targets(one: Map, texts: Texts, *, effects: bool) -> Chart:
    x = np.arange(1.0, len(one.before_um) + 1)
    lines = [Line(texts("gap_before"), "measured", x, one.before_um, points=True)]
    lines += [Line(texts("gap_after"), "after", x, one.after_um, points=True)] if effects else []
    title, y_label = texts("chart_gap", what=one.test), f"{texts('gap')} / µm"
    caption = texts("caption_gap_targets")
    return Chart(title, caption, "targets", texts("reading_number"), y_label, "µm", tuple(lines))
