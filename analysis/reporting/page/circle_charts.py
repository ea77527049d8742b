"""Pictures of yaw and roll: acw and cw over each other, straight and polar, of the angle and of the distance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.measures.link_angle import CircleResult
from analysis.measures.reduction import PHI
from analysis.measures.result_curves import CircleCurve
from analysis.measures.results import Result
from analysis.reporting.page.chart import Chart, Frame, Line, Role, marks_of
from analysis.reporting.texts import Texts

_FRAMES: tuple[Frame, ...] = ("straight", "polar")
_DIRECTIONS: tuple[Role, ...] = ("acw", "cw")
_EACH_DEG = 2.0
"""A joint's curve turns slowly: a point each so many degrees draws it."""
_JOINT_ROLES: tuple[Role, ...] = ("acw", "cw", "after", "quiet", "fifth", "sixth")


def circle_charts(group: Sequence[Result], texts: Texts) -> list[Chart]:
    """The error of the angle and of the distance, along the circle and around it."""
    test = group[0].test
    marks = marks_of([(reversal.phi_deg, reversal.joint) for reversal in group[0].reversals], texts)
    charts = []
    for frame in _FRAMES:
        for part, unit, label in (("angle", "°", "error_angle"), ("distance", "µm", "error_distance")):
            lines = []
            for role in _DIRECTIONS:
                of_role = [result.curve for result in group if result.measured.run.manifest.direction == role]
                if curves := [curve for curve in of_role if isinstance(curve, CircleCurve)]:  # their mean is drawn
                    many = f" ({texts('mean_of_runs', count=len(curves))})" if len(curves) > 1 else ""
                    values = [curve.error_deg if part == "angle" else 1e3 * curve.deviation_mm for curve in curves]
                    lines.append(Line(f"{role}{many}", role, np.degrees(PHI), np.mean(values, axis=0)))
            title = texts(f"chart_{part}_{frame}", test=texts.test(test))
            caption = texts(f"caption_{part}_{frame}")
            y_label = f"{texts(label)} / {unit}"
            charts.append(Chart(title, caption, frame, texts("circle_angle"), y_label, unit, tuple(lines), marks))
    return charts


def joint_chart(group: Sequence[Result], texts: Texts) -> Chart:
    """Each joint's angle over the circle, less its mean, from the first run's own feedback."""
    marks = marks_of([(reversal.phi_deg, reversal.joint) for reversal in group[0].reversals], texts)
    circle = next(result.found for result in group if isinstance(result.found, CircleResult))
    robot = group[0].measured.rig.robot
    lap = circle.laps.first
    order = np.argsort(lap.phi % (2 * np.pi))
    phi_deg, q = np.degrees(lap.phi % (2 * np.pi))[order], np.degrees(lap.q[order])
    at_deg = np.arange(0.0, 360.0, _EACH_DEG)
    lines, squares = [], []
    for axis, role in enumerate(_JOINT_ROLES):
        whole_turn = abs(q[:, axis].max() - q[:, axis].min()) > 300.0
        if not whole_turn:  # a joint that goes round with the circle would hide the others
            curve = np.interp(at_deg, phi_deg, q[:, axis])
            lines.append(Line(texts.axis(robot, axis + 1), role, at_deg, curve - curve.mean()))
            at = [reversal.phi_deg for reversal in group[0].reversals if reversal.joint == axis + 1]
            squares += [(phi, float(np.interp(phi, at_deg, curve - curve.mean()))) for phi in at]
    if squares:
        phi, angle_deg = np.array(squares).T
        lines.append(Line(texts("turns_back"), "model", phi, angle_deg, points=True))
    caption = texts("caption_joints")
    return Chart(
        texts("chart_joints"),
        caption,
        "straight",
        texts("circle_angle"),
        texts("joint_angle"),
        "°",
        tuple(lines),
        marks,
    )
