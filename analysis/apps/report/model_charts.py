"""Charts of the model: measured and simulated runs, residuals before and after the diagnosis, and its picture."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from heapq import nlargest

import numpy as np

from analysis.apps.report.chart import Chart, ChartLine, Role, marks_of, stretches
from analysis.apps.report.diagnosis_answer import Stairs
from analysis.apps.report.diagnosis_words import runs_of
from analysis.apps.report.texts import Texts
from analysis.diagnosis.judge.comparison import Compared, Comparison, LocatedResidual
from analysis.diagnosis.judge.residuals import Curve, Map
from analysis.diagnosis.judge.result import Diagnosis
from analysis.procedures.repeatability import SIDES, RepeatabilityResult
from analysis.procedures.results import Result
from analysis.procedures.shared.test_kind import labels_of
from analysis.robot.kinematics.arm import Array
from analysis.runs.noise.readings import rms

_MOST_MAPS = 3
_ARROWS = {"out": "↓", "in": "↑"}
"""Symbols of the approach sides, as in R↓ and R↑ of ISO 230-2."""
_IN_PICTURE = {"deg": ("°", 1.0), "mm": ("µm", 1e3)}
_PARTS = {"distance": np.array([0.5, 0.5]), "angle": np.array([-1.0, 1.0])}
_MOST_ROWS = 6
_ALONG = {"phi_deg": "circle_angle", "target": "target", "place": "target_and_side"}


def simulated_charts(
    simulated: Compared | None, corrected: Compared | None, group: Sequence[Result], texts: Texts
) -> list[Chart]:
    """Measured and simulated error for each direction, as means of repeated runs.

    corrected: runs compared with the model including the effects, if any.
    """
    paths = {result.measured.path for result in group}
    by_title: dict[str, tuple[list[Comparison], list[Comparison]]] = {}
    for place, compared in enumerate((simulated, corrected)):
        for comparison in compared.runs if compared else ():
            if comparison.result.measured.path in paths:
                by_title.setdefault(comparison.result.title, ([], []))[place].append(comparison)
    return [compared_chart(before, after, texts) for before, after in by_title.values()]


def compared_chart(before: Sequence[Comparison], after: Sequence[Comparison], texts: Texts) -> Chart:
    result, is_angle = before[0].result, before[0].unit == "deg"
    unit, factor = _IN_PICTURE[before[0].unit]
    # Places of a repeatability run: each target from outside and from inside
    targets = result.found.targets if isinstance(result.found, RepeatabilityResult) else ()
    places = [f"{target} {_ARROWS[side]}" for target in targets for side in SIDES]
    # Means of the runs at the same positions
    alike, with_effects = ([run for run in runs if np.array_equal(run.x, runs[0].x)] for runs in (before, after))
    drawn: list[tuple[str, Role, list[Array]]] = [
        ("measured", "measured", [run.measured_curve for run in alike]),
        ("simulated", "model", [run.simulated_curve for run in alike]),
        ("simulated_with", "after", [run.simulated_curve for run in with_effects]),
    ]
    lines = [
        ChartLine(texts(name), role, before[0].x, factor * np.mean(curves, axis=0), points=not is_angle)
        for name, role, curves in drawn
        if curves
    ]
    return Chart(
        texts("chart_simulated", what=result.title), texts("caption_simulated"),
        "straight" if is_angle else "targets", texts(_ALONG[labels_of(result.measured.table.test).along]),
        f"{texts('error')} / {unit}", unit, tuple(lines),
        ticks=tuple((float(place), name) for place, name in enumerate(places)),
    )  # fmt: skip


def residual_charts(residuals: Diagnosis | LocatedResidual, stairs: Stairs | None, texts: Texts) -> list[Chart]:
    """Measured error, accumulated parts and residual of circles and targets; without a staircase the residual only."""
    charts, staircase = _strand_charts(residuals, texts), residuals.staircase
    if stairs and charts:
        charts[0] = replace(charts[0], panels=tuple(stairs.step_names(texts)))
    steps = staircase.maps if staircase else [target_map.before_um[None] for target_map in residuals.maps]
    maps = list(zip(residuals.maps, steps, strict=True))[:_MOST_MAPS]
    return [*charts, *(_target_chart(target_map, steps_um, texts) for target_map, steps_um in maps)]


_Strand = tuple[str, Curve, Array, tuple[tuple[float, float], ...]]
"""Name, circle, residuals (steps, n) µm, and shaded places of the angle or distance part of a circle."""


def _loudest_strands(residuals: Diagnosis | LocatedResidual) -> list[_Strand]:
    """The part of each circle with the larger disagreement; the smallest residuals are omitted."""
    staircase, strands = residuals.staircase, []
    steps = staircase.curves if staircase else [curve.before_um[None] for curve in residuals.curves]
    for curve, steps_um in zip(residuals.curves, steps, strict=True):  # steps_um (steps, n, 2) µm
        places = [place for place in residuals.where if (place.test, place.direction) == (curve.test, curve.direction)]
        # Rms in units of the gauge noise, which is larger in a difference than in a mean
        sizes = {part: rms(steps_um[0] @ way) / float(np.linalg.norm(way)) for part, way in _PARTS.items()}
        # The part with the worst located place; if there is none, the part with the larger residual relative to noise
        worst = max(places, key=lambda place: place.sigma, default=None)
        part = worst.part if worst else max(sizes, key=sizes.__getitem__)
        shaded = stretches([(place.from_deg, place.to_deg) for place in places if place.part == part])
        strands.append((sizes[part], (f"{runs_of(curve)}, {part}", curve, steps_um @ _PARTS[part], shaded)))
    loudest = nlargest(_MOST_ROWS, range(len(strands)), key=lambda k: strands[k][0])
    return [strands[k][1] for k in sorted(loudest)]


def _strand_charts(residuals: Diagnosis | LocatedResidual, texts: Texts) -> list[Chart]:
    strands = _loudest_strands(residuals)
    charts, count, drawn = [], Counter(title for title, *_ in strands), Counter[str]()
    for title, curve, steps_um, shaded in strands:
        drawn[title] += 1  # circles at several places share a title and are numbered
        name = texts("chart_place", what=title, number=drawn[title]) if count[title] > 1 else title
        order = np.argsort(curve.phi_deg % 360)
        x, left_um = (curve.phi_deg % 360)[order], steps_um[:, order]
        so_far = left_um[0] - left_um
        lines = [ChartLine(texts("measured"), "measured", x, left_um[0])]
        if len(left_um) > 1:
            lines.append(ChartLine(texts("so_far"), "model", x, so_far[-1], steps=so_far))
            lines.append(ChartLine(texts("still_left"), "after", x, left_um[-1], steps=left_um))
        about = texts("chart_simulated" if len(left_um) > 1 else "chart_gap", what=name), texts("caption_step")
        labels, marks = (texts("circle_angle"), texts("gap")), marks_of(curve.turns, texts)
        charts.append(Chart(*about, "straight", *labels, "µm", tuple(lines), marks, shaded))
    return charts


def _target_chart(target_map: Map, steps_um: Array, texts: Texts) -> Chart:
    x = np.arange(1.0, len(target_map.before_um) + 1)
    lines = [ChartLine(texts("gap_before"), "measured", x, steps_um[0], points=True)]
    if len(steps_um) > 1:
        lines.append(ChartLine(texts("still_left"), "after", x, steps_um[-1], points=True, steps=steps_um))
    about = texts("chart_gap", what=target_map.test), texts("caption_gap_targets")
    return Chart(*about, "targets", texts("reading_number"), texts("gap"), "µm", tuple(lines))
