"""Pictures of the model: measured beside simulated for each test, and before and after the diagnosis."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

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
from analysis.reporting.stairs import stairs_of
from analysis.reporting.texts import Texts

_MOST_MAPS = 3
_ARROWS = {"out": "↓", "in": "↑"}
"""Sides of approach as ISO 230-2 marks them in R↓ and R↑."""
_IN_PICTURE = {"deg": ("°", 1.0), "mm": ("µm", 1e3)}
"""Unit and factor in which a compared curve is drawn."""


_ALONG = {"phi_deg": "circle_angle", "target": "target", "place": "target_and_side"}


def simulated_charts(report: Report, group: Sequence[Result], texts: Texts) -> list[Chart]:
    """Measured and simulated error of a group of runs, a picture for each direction; repeated runs as their mean."""
    before, after = _of_group(report.simulated, group), _of_group(report.corrected, group)
    # The names of the places of a repeatability run: each target from outside and from inside
    targets = group[0].found.targets if isinstance(group[0].found, RepeatabilityResult) else ()
    places = (f"{target} {_ARROWS[side]}" for target in targets for side in SIDES)
    charts, ticks = [], tuple((float(place), name) for place, name in enumerate(places))
    for title in dict.fromkeys(comparison.result.title for comparison in before):
        x, measured, simulated = _means(before, title)
        unit, factor = _IN_PICTURE[before[0].unit]
        lines = [Line(texts("measured"), "measured", x, factor * measured, points=before[0].unit == "mm")]
        lines.append(Line(texts("simulated"), "model", x, factor * simulated, points=before[0].unit == "mm"))
        if after:
            with_effects = factor * _means(after, title)[2]
            name = texts("simulated_with")
            lines.append(Line(name, "after", x, with_effects, points=before[0].unit == "mm"))
        straight = before[0].unit == "deg"
        x_label = texts(_ALONG[group[0].measured.table.kind.along])
        chart_title, caption = texts("chart_simulated", what=title), texts("caption_simulated")
        y_label = f"{texts('error')} / {unit}"
        frame = "straight" if straight else "targets"
        charts.append(Chart(chart_title, caption, frame, x_label, y_label, unit, tuple(lines), ticks=ticks))  # type: ignore[arg-type]
    return charts


def _of_group(compared: Compared | None, group: Sequence[Result]) -> list[Comparison]:
    """The comparisons of the runs of a group."""
    paths = {result.measured.path for result in group}
    return [comparison for comparison in compared.runs if comparison.result.measured.path in paths] if compared else []


def _means(runs: Sequence[Comparison], title: str) -> tuple[Array, Array, Array]:
    """Positions (n,), measured and simulated curve (n,): the mean over the runs that have the places of the first."""
    of_title = [comparison for comparison in runs if comparison.result.title == title]
    alike = [comparison for comparison in of_title if np.array_equal(comparison.x, of_title[0].x)]
    measured = np.mean([comparison.measured_curve for comparison in alike], axis=0)
    simulated = np.mean([comparison.simulated_curve for comparison in alike], axis=0)
    return of_title[0].x, measured, simulated


def diagnosis_charts(diagnosis: Diagnosis, texts: Texts) -> list[Chart]:
    """Readings beside the model at each step of the staircase: along the circles, and what is left at targets."""
    stairs = stairs_of(diagnosis, texts)
    strands, _ = strands_of(diagnosis)
    charts, count, so_far = [], Counter(strand.title for strand in strands), Counter[str]()
    for strand in strands:  # `yaw acw, angle`; several of one title, of circles at several places, with their number
        title = strand.title
        so_far[title] += 1
        if count[title] > 1:
            title = texts("chart_place", what=title, number=so_far[title])
        charts.append(_of_circle(strand, title, texts))
    if stairs and charts:
        charts[0] = replace(charts[0], panels=tuple(step.name for step in stairs.steps))
    steps = (
        diagnosis.staircase.maps
        if diagnosis.staircase
        else [np.array([target_map.before_um]) for target_map in diagnosis.maps]
    )
    return [
        *charts,
        *(_of_targets(*both, texts) for both in list(zip(diagnosis.maps, steps, strict=True))[:_MOST_MAPS]),
    ]


def _of_circle(strand: Strand, title: str, texts: Texts) -> Chart:
    """Measured, simulated with the parts so far, and what is left; without steps, what is left alone."""
    steps, x = strand.steps_um, strand.phi_deg
    so_far = steps[0] - steps
    lines = [Line(texts("measured"), "measured", x, steps[0])]
    if len(steps) > 1:
        lines.append(Line(texts("so_far"), "model", x, so_far[-1], steps=so_far))
        lines.append(Line(texts("still_left"), "after", x, steps[-1], steps=steps))
    marks = marks_of(strand.curve.turns, texts)
    shaded = stretches([(place.from_deg, place.to_deg) for place in strand.places if not whole_lap(place)])
    return Chart(
        texts("chart_simulated" if len(steps) > 1 else "chart_gap", what=title), texts("caption_step"),
        "straight", texts("circle_angle"), f"{texts('gap')} / µm", "µm", tuple(lines), marks, shaded,
    )  # fmt: skip


def _of_targets(target_map: Map, steps_um: Array, texts: Texts) -> Chart:
    x = np.arange(1.0, len(target_map.before_um) + 1)
    lines = [Line(texts("gap_before"), "measured", x, steps_um[0], points=True)]
    if len(steps_um) > 1:
        lines.append(Line(texts("still_left"), "after", x, steps_um[-1], points=True, steps=steps_um))
    title, y_label = texts("chart_gap", what=target_map.test), f"{texts('gap')} / µm"
    return Chart(title, texts("caption_gap_targets"), "targets", texts("reading_number"), y_label, "µm", tuple(lines))
