"""Pictures of tests at targets: the hemisphere about its least-squares sphere, repeatability, and poses."""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Array
from analysis.measures.axis_curves import AxisCurve
from analysis.measures.result_curves import PathCurve, PoseCurve, RadialCurve, RepeatabilityCurve
from analysis.measures.results import Result
from analysis.reporting.iso_views import PlaneView, cube_view, path_view
from analysis.reporting.page.chart import Chart, Line, Picture, Role, SphereChart
from analysis.reporting.texts import Texts

_GRID = (13, 37)
"""Nodes of the drawn surface in polar angle and azimuth: each 7.5° and 10° of a hemisphere."""
_NEAR = 4
"""Targets that a node of the surface is interpolated from."""


def target_charts(result: Result, texts: Texts) -> list[Picture]:
    """The pictures of one run."""
    match result.curve:
        case RadialCurve() as curve:
            return [_sphere(result, curve, texts), _by_target(result, curve, texts)]
        case RepeatabilityCurve() as curve:
            return [_repeatability(result, curve, texts)]
        case PoseCurve() as curve:
            view = cube_view(result)
            return [
                *([] if view is None else [_plane(view, "chart_cube", texts, points=True)]),
                _poses(result, curve, texts),
                *(_axis(axis, texts) for axis in curve.axes),
            ]
        case PathCurve() as curve:
            return [_plane(path_view(curve), "chart_paths", texts, points=False), _along(curve, texts)]
    return []


def directions(polar_deg: Array, azimuth_deg: Array) -> Array:
    """Unit vectors (..., 3) in the hemisphere's frame: z to its middle, x to azimuth 0."""
    polar, azimuth = np.radians(polar_deg), np.radians(azimuth_deg)
    return np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=-1)


def interpolated(targets: Array, values_mm: Array, nodes: Array) -> Array:
    """Values (...,) mm at nodes (..., 3) from those (t,) at targets (t, 3): weighted by the inverse square of the angle
    between, over the nearest (Shepard 1968), so that the surface passes through every target."""
    angle = np.arccos(np.clip(nodes @ targets.T, -1.0, 1.0))
    near = np.argsort(angle, axis=-1)[..., :_NEAR]
    weight = 1.0 / np.maximum(np.take_along_axis(angle, near, axis=-1), 1e-6) ** 2
    mean: Array = (weight * values_mm[near]).sum(axis=-1) / weight.sum(axis=-1)
    return mean


def _sphere(result: Result, curve: RadialCurve, texts: Texts) -> SphereChart:
    used = curve.used
    targets = directions(curve.polar_deg, curve.azimuth_deg)
    polar, azimuth = np.meshgrid(
        np.linspace(0.0, float(curve.polar_deg.max()), _GRID[0]), np.linspace(0.0, 360.0, _GRID[1]), indexing="ij"
    )
    grid = directions(polar, azimuth)
    names = tuple(
        f"{texts('target')} {number}: {1e3 * deviation:+.1f} µm"
        for number, deviation in zip(curve.target[used], curve.deviation_mm[used], strict=True)
    )
    chart = SphereChart(
        texts("chart_sphere"), "", result.figures["radius_mm"].value, grid,
        interpolated(targets[used], curve.deviation_mm[used], grid), targets[used], curve.deviation_mm[used], names,
        (texts("sphere"), texts("surface"), texts("targets")),
    )  # fmt: skip
    caption = texts("caption_sphere", times=f"{float(f'{chart.magnified:.2g}'):g}")
    return SphereChart(**{**vars(chart), "caption": caption})


def _by_target(result: Result, curve: RadialCurve, texts: Texts) -> Chart:
    half_um = 500 * curve.spread_mm if "spread_mm" in result.figures else None
    x = curve.target.astype(float)
    line = Line(texts("measured"), "measured", x, 1e3 * curve.deviation_mm, points=True, half=half_um)
    y_label = f"{texts('error_radius')} / µm"
    caption = texts("caption_targets")
    return Chart(texts("chart_targets"), caption, "targets", texts("target"), y_label, "µm", (line,))


def _repeatability(result: Result, curve: RepeatabilityCurve, texts: Texts) -> Chart:
    """Every reading by target and side of approach, from the middle of its target's readings."""
    targets, place = np.unique(curve.target, return_inverse=True)
    middle = np.array([curve.reading_mm[place == k].mean() for k in range(len(targets))])
    away_um = 1e3 * (curve.reading_mm - middle[place])
    lines = []
    for side, aside, role in (("out", -0.12, "acw"), ("in", 0.12, "cw")):
        on_side = curve.approach == side
        lines.append(Line(texts(f"from_{side}"), role, place[on_side] + aside, away_um[on_side], points=True))  # type: ignore[arg-type]
    ticks = tuple((float(k), str(target)) for k, target in enumerate(targets))
    y_label = f"{texts('reading')} / µm"
    caption = texts("caption_repeatability")
    title = texts("chart_repeatability")
    return Chart(title, caption, "targets", texts("target"), y_label, "µm", tuple(lines), ticks=ticks)


def _poses(result: Result, curve: PoseCurve, texts: Texts) -> Chart:
    number = np.arange(1.0, len(curve.distance_mm) + 1)
    line = Line(texts("measured"), "measured", number, curve.distance_mm, points=True)
    y_label = f"{texts('error_position')} / mm"
    return Chart(texts("chart_pose"), texts("caption_pose"), "targets", texts("pose"), y_label, "mm", (line,))


def _axis(curve: AxisCurve, texts: Texts) -> Chart:
    """The error of the angle of an axis that was driven alone, by the way it turned."""
    ways: tuple[tuple[str, Role, Array], ...] = (("up", "acw", curve.up_deg), ("down", "cw", curve.down_deg))
    lines = tuple(
        Line(texts(f"turned_{way}"), role, curve.angle_deg[reached], 1e3 * off[reached], points=True)
        for way, role, off in ways
        if (reached := np.isfinite(off)).any()
    )
    title = texts("chart_axis", axis=curve.axis)
    return Chart(title, texts("caption_axis"), "targets", texts("angle_of_axis"), texts("error_of_angle"), "m°", lines)


def _plane(view: PlaneView, title: str, texts: Texts, *, points: bool) -> Chart:
    """Commands on the cube's plane, and where the tool was, its deviation enlarged."""
    attained = Line(texts("attained"), "cw", view.attained_mm[:, 0], view.attained_mm[:, 1], points=points)
    command = Line(texts("commanded"), "quiet", view.command_mm[:, 0], view.command_mm[:, 1], points=points)
    caption = texts("caption_plane", times=f"{view.times:g}")
    labels = f"{texts('level')} / mm", f"{texts('rising')} / mm"
    return Chart(texts(title), caption, "plane", *labels, "mm", (attained, command))


def _along(curve: PathCurve, texts: Texts) -> Chart:
    """How far the mean of all cycles is from the command, along each path."""
    roles: tuple[Role, ...] = ("acw", "cw", "after", "fifth", "quiet")
    lines = []
    for name, role in zip(dict.fromkeys(curve.path.tolist()), roles, strict=False):
        rows = curve.path == name
        lines.append(Line(texts(f"path_{name}"), role, 100 * curve.share[rows], 1e3 * curve.at_mm[rows]))
    labels = f"{texts('along_path')} / %", f"{texts('error_path')} / µm"
    return Chart(texts("chart_along"), texts("caption_along"), "targets", *labels, "µm", tuple(lines))
