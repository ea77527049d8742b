"""Charts of evaluated runs, for the page and as picture files: circles, hemisphere, repeatability, poses, and the cube
and paths of ISO 9283 on their plane.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from analysis.apps.report.chart import (
    Chart,
    ChartLine,
    Frame,
    Picture,
    Role,
    SphereChart,
    marks_of,
)
from analysis.apps.report.pose_charts import NO_POSES, PoseModel, pose_charts
from analysis.apps.report.texts import Texts
from analysis.apps.report.titled_charts import plane_chart, titled_chart
from analysis.procedures.circle import CircleResult
from analysis.procedures.results import Result
from analysis.procedures.shared.lap_curve import PHI
from analysis.procedures.shared.result_curves import CircleCurve, PathCurve, PoseCurve, RadialCurve, RepeatabilityCurve
from analysis.robot.geometry.iso_cube import FROM_CENTRE
from analysis.robot.kinematics.arm import Array, Mask
from rigs.text import counted

_FRAMES: tuple[Frame, ...] = ("straight", "polar")
_DIRECTIONS: tuple[Role, ...] = ("acw", "cw")
_EACH_DEG = 2.0
_FULL_TURN_DEG = 300.0
"""Range of a joint above which it would dwarf the others, and is not drawn."""
_JOINT_ROLES: tuple[Role, ...] = ("acw", "cw", "after", "quiet", "fifth", "sixth")
_GRID = (13, 37)
"""Polar angle and azimuth: every 7.5° and 10° of a hemisphere."""
_NEAR = 4
_STATIONS = 80


def circle_charts(group: Sequence[Result], texts: Texts) -> list[Chart]:
    marks = marks_of([(reversal.phi_deg, reversal.joint) for reversal in group[0].reversals], texts)
    charts = []
    for frame in _FRAMES:
        for part, unit in (("angle", "°"), ("distance", "µm")):
            lines = []
            for role in _DIRECTIONS:
                of_role = [result.curve for result in group if result.measured.run.manifest.direction == role]
                if curves := [curve for curve in of_role if isinstance(curve, CircleCurve)]:  # draw the mean
                    many = f" ({texts('mean_of_runs', count=len(curves))})" if len(curves) > 1 else ""
                    values = [curve.error_deg if part == "angle" else 1e3 * curve.deviation_mm for curve in curves]
                    lines.append(ChartLine(f"{role}{many}", role, np.degrees(PHI), np.mean(values, axis=0)))
            labels = "circle_angle", f"error_{part}"
            chart = titled_chart(f"{part}_{frame}", frame, labels, unit, lines, texts, test=texts.test(group[0].test))
            charts.append(replace(chart, marks=marks))
    return charts


def raw_charts(group: Sequence[Result], texts: Texts) -> list[Chart]:
    """Angle and least-squares sine of each run (figure 3 of the paper), on a common scale."""
    whole, charts = np.linspace(0, 2 * np.pi, 361), list[Chart]()
    for result in group:
        if not isinstance(circle := result.found, CircleResult):
            continue
        angles, laps = np.tile(np.degrees(PHI), len(circle.curve.laps)), np.degrees(circle.curve.laps).ravel()
        readings = f"{texts('measured')}, {counted(circle.laps.count, 'lap')}"
        sine = f"{texts.label('amplitude_deg')} {circle.figures['amplitude_deg']}"
        lines = (
            ChartLine(readings, circle.laps.direction, angles, laps, points=True),
            ChartLine(sine, "sixth", np.degrees(whole), np.degrees(circle.sine(whole))),
        )
        title, labels = f"{circle.laps.direction} · {result.name}", (texts("circle_angle"), f"{result.test} / °")
        charts.append(Chart(title, "", "straight", *labels, "°", lines))
    spans = [chart.reach for chart in charts]
    return [replace(chart, span=(min(low for low, _ in spans), max(high for _, high in spans))) for chart in charts]


def joint_chart(group: Sequence[Result], texts: Texts) -> Chart:
    """Joint angles over the circle minus their means, of the first run."""
    reversals, robot = group[0].reversals, group[0].measured.rig.robot
    lap = next(result.found for result in group if isinstance(result.found, CircleResult)).laps.first
    phi_deg, q_deg = np.degrees(lap.phi), np.degrees(lap.q)
    at_deg, lines, turns = np.arange(0.0, 360.0, _EACH_DEG), [], list[tuple[float, float]]()
    for axis, (role, angle_deg) in enumerate(zip(_JOINT_ROLES, q_deg.T, strict=True), start=1):
        if np.ptp(angle_deg) > _FULL_TURN_DEG:
            continue
        curve = np.interp(at_deg, phi_deg, angle_deg, period=360)
        curve -= curve.mean()
        lines.append(ChartLine(texts.axis(robot, axis), role, at_deg, curve))
        places = [reversal.phi_deg for reversal in reversals if reversal.joint == axis]
        turns += zip(places, np.interp(places, at_deg, curve, period=360).tolist(), strict=True)
    if turns:
        phi, turn_deg = np.array(turns).T
        lines.append(ChartLine(texts("turns_back"), "model", phi, turn_deg, points=True))
    chart = titled_chart("joints", "straight", ("circle_angle", "joint_angle"), "°", lines, texts)
    return replace(chart, marks=marks_of([(reversal.phi_deg, reversal.joint) for reversal in reversals], texts))


# Tests at targets.


def target_charts(result: Result, texts: Texts, poses: PoseModel = NO_POSES) -> list[Picture]:
    """poses: errors that remain with a better model of the arm."""
    match result.curve:
        case RadialCurve() as curve:
            return _hemisphere(result, curve, texts)
        case RepeatabilityCurve() as curve:
            return [_repeatability(curve, texts)]
        case PoseCurve() as curve:
            return pose_charts(result, curve, texts, poses)
        case PathCurve() as curve:
            return _paths(curve, texts)
    return []


def directions(polar_deg: Array, azimuth_deg: Array) -> Array:
    """Unit vectors (..., 3) in the frame of the hemisphere: z to the middle, x to azimuth 0."""
    polar, azimuth = np.radians(polar_deg), np.radians(azimuth_deg)
    return np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=-1)


def interpolated(targets: Array, values_mm: Array, nodes: Array) -> Array:
    """Interpolate values (t,) mm at targets (t, 3) to nodes (..., 3), by inverse squared angle (Shepard 1968)."""
    chord, near = KDTree(targets).query(nodes, range(1, min(_NEAR, len(targets)) + 1))
    angle = np.maximum(2 * np.arcsin(chord / 2), 1e-6)
    return np.asarray(np.average(values_mm[near], axis=-1, weights=1.0 / angle**2))


def _hemisphere(result: Result, curve: RadialCurve, texts: Texts) -> list[Picture]:
    used = curve.used
    targets, deviation_mm = directions(curve.polar_deg, curve.azimuth_deg)[used], curve.deviation_mm[used]
    polar, azimuth = np.linspace(0.0, curve.polar_deg.max(), _GRID[0]), np.linspace(0.0, 360.0, _GRID[1])
    grid = directions(*np.meshgrid(polar, azimuth, indexing="ij"))
    names = tuple(
        f"{texts('target')} {number}: {1e3 * deviation:+z.1f} µm"
        for number, deviation in zip(curve.target[used], deviation_mm, strict=True)
    )
    chart = SphereChart(
        texts("chart_sphere"), "", result.figures["radius_mm"].value, grid, interpolated(targets, deviation_mm, grid),
        targets, deviation_mm, names, (texts("sphere"), texts("surface"), texts("targets")),
    )  # fmt: skip
    sphere = replace(chart, caption=texts("caption_sphere", times=f"{float(f'{chart.magnified:.2g}'):g}"))
    ways: tuple[tuple[str, Role, Mask], ...] = (("measured", "measured", used), ("not_used", "sixth", ~used))
    x, y = curve.target.astype(float), 1e3 * curve.deviation_mm
    half_um = 500 * curve.spread_mm if "spread_mm" in result.figures else None
    lines = [
        ChartLine(texts(name), role, x[at], y[at], points=True, half=None if half_um is None else half_um[at])
        for name, role, at in ways
        if at.any()
    ]
    return [sphere, titled_chart("targets", "targets", ("target", "error_radius"), "µm", lines, texts)]


def _repeatability(curve: RepeatabilityCurve, texts: Texts) -> Chart:
    """Readings by target and approach side, relative to the mean of the target."""
    targets, place = np.unique(curve.target, return_inverse=True)
    middle = np.array([curve.reading_mm[place == k].mean() for k in range(len(targets))])
    away_um = 1e3 * (curve.reading_mm - middle[place])
    lines = []
    for side, aside, role in (("out", -0.12, "acw"), ("in", 0.12, "cw")):
        on_side = curve.approach == side
        lines.append(ChartLine(texts(f"from_{side}"), role, place[on_side] + aside, away_um[on_side], points=True))  # type: ignore[arg-type]
    ticks = tuple((float(k), str(target)) for k, target in enumerate(targets))
    return replace(titled_chart("repeatability", "targets", ("target", "reading"), "µm", lines, texts), ticks=ticks)


def _paths(curve: PathCurve, texts: Texts) -> list[Picture]:
    """The paths on the plane, and the deviations along them."""
    names = [*dict.fromkeys(curve.path.tolist())]
    command, off, gap = list[Array](), list[Array](), np.full((1, 2), np.nan)
    for name in [path for path in names if path != "small_circle"] or names:  # limited to the magnified size
        rows = np.flatnonzero(curve.path == name)
        rows = rows[:: max(1, len(rows) // _STATIONS)]
        command += [curve.place_mm[rows, :2], gap]
        off += [curve.off_mm[rows, :2], gap]
    places, away = np.concatenate(command), np.concatenate(off)
    side = float(np.nanmax(np.abs(places[:, 0]))) / FROM_CENTRE
    plane = plane_chart("chart_paths", places, places, away, side, texts, points=False)
    roles: tuple[Role, ...] = ("acw", "cw", "after", "fifth", "quiet")
    shares, errors = 100 * curve.share, 1e3 * curve.at_mm
    on_path = [(name, role, curve.path == name) for name, role in zip(names, roles, strict=False)]
    lines = [ChartLine(texts(f"path_{name}"), role, shares[rows], errors[rows]) for name, role, rows in on_path]
    return [plane, titled_chart("along", "targets", ("along_path", "error_path"), "µm", lines, texts)]
