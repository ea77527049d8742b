"""Charts of poses: errors by pose and on the arm, the cube of ISO 9283, and axes driven by themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from analysis.apps.report.chart import ArmChart, Chart, ChartLine, ErrorVectors, Picture, Role
from analysis.apps.report.texts import Texts
from analysis.apps.report.titled_charts import plane_chart, titled_chart
from analysis.diagnosis.judge.comparison import PoseComparison
from analysis.procedures.pose import PoseResult
from analysis.procedures.results import Result
from analysis.procedures.shared.axis_curves import AxisCurve
from analysis.procedures.shared.result_curves import PoseCurve
from analysis.procedures.shared.scatter_figures import poses_of_cube
from analysis.robot.geometry.iso_cube import cube_of
from analysis.robot.geometry.pose_setup import frame, in_each_frame, in_frame
from analysis.robot.kinematics.arm import (
    Arm,
    Array,
    Integers,
    Mask,
    arm_of,
    base_places,
    forward,
    link_frames,
    without_setup,
)
from analysis.runs.noise.readings import evenly
from rigs.schema.vocabulary import DRIVEN_AXES

_MOST_VECTORS = 200
"""Number of poses with a vector. Chosen: more hide each other."""
_LONGEST = 0.16
"""Length of the largest error vector, as a share of the size of the drawn arm and places. Chosen."""


@dataclass(frozen=True)
class PoseModel:
    """Errors of poses that remain with a better model of the arm.

    held_out: by run, the rows of its table, from 1, that were not used to fit the model.
    """

    errors: tuple[PoseComparison, ...] = ()
    held_out: Mapping[str, Sequence[int]] = field(default_factory=dict)

    def error_sets(self, result: Result, rows: Integers, texts: Texts) -> list[ErrorVectors]:
        """Errors (n, 3) mm of the poses at `rows` (n,) of a run, those used to fit the model before the others."""
        errors = np.full((len(result.measured.table.q), 3), np.nan)
        for part in self.errors:
            if part.path == result.measured.path:
                errors[part.rows] = part.error_mm
        held_out = np.zeros(len(errors), dtype=bool)
        held_out[np.array(self.held_out.get(result.measured.run.manifest.name, ()), dtype=int) - 1] = True
        sets: tuple[tuple[str, Role, Mask], ...] = (
            ("poses_used", "after", ~held_out),
            ("poses_held_out", "model", held_out),
        )
        named = [ErrorVectors(key, role, np.where(chosen[:, None], errors, np.nan)[rows]) for key, role, chosen in sets]
        return [replace(one, name=_with_rms(texts(one.name), one.errors_mm)) for one in named if one.there.any()]


NO_POSES = PoseModel()


def pose_charts(result: Result, curve: PoseCurve, texts: Texts, poses: PoseModel) -> list[Picture]:
    """The cube stops, the error of every pose, the arm with the errors, and each axis that was driven by itself."""
    view, number = _cube_view(result), np.arange(1.0, len(curve.distance_mm) + 1)
    sets = [ErrorVectors(_with_rms(texts("poses_before"), curve.error_mm), "measured", curve.error_mm)]
    found = result.found if isinstance(result.found, PoseResult) else None
    sets += poses.error_sets(result, found.rows, texts) if found else []
    lines = [ChartLine(one.name, one.role, number[one.there], one.sizes_mm[one.there], points=True) for one in sets]
    pictures: list[Picture] = [] if view is None else [plane_chart("chart_cube", *view, texts, points=True)]
    pictures.append(titled_chart("pose", "targets", ("pose", "error_position"), "mm", lines, texts))
    if found:
        pictures.append(_arm_chart(result, found, sets, texts))
    return [*pictures, *(_axis_chart(axis, texts) for axis in curve.axes)]


def _with_rms(name: str, errors_mm: Array) -> str:
    sizes = np.linalg.norm(errors_mm[np.isfinite(errors_mm).all(axis=1)], axis=1)
    return f"{name}, {np.sqrt(np.mean(sizes**2)):#.2g}".removesuffix(".") + " mm rms"


def _arm_chart(result: Result, found: PoseResult, sets: Sequence[ErrorVectors], texts: Texts) -> ArmChart:
    """The arm in the measured posture nearest to the median of all, and up to 200 errors, the largest among them."""
    arm, q = without_setup(arm_of(result.measured.rig.robot)), result.measured.table.q[found.rows]
    tool, sizes = found.setup.T_flange_tool[:3, 3], sets[0].sizes_mm
    drawn = np.unique([*evenly(len(q), _MOST_VECTORS), int(np.argmax(sizes))])
    places = in_each_frame(forward(arm, q), tool)
    posture = int(np.argmin(np.linalg.norm(q - np.median(q, axis=0), axis=1)))
    links, joints = _links(arm, q[posture : posture + 1], tool)
    extent = float(np.linalg.norm(np.ptp(np.concatenate([links, places]), axis=0)))
    times = float(f"{_LONGEST * extent / max(float(sizes.max()), 1e-9):.1g}")
    values = {"times": f"{times:g}", "largest": f"{sizes.max():.2g}", "pose": posture + 1}
    names = tuple(f"{texts('pose')} {row + 1}: {sizes[row]:.3g} mm" for row in drawn)
    return ArmChart(
        texts("chart_arm"), texts("caption_arm", **values), result.measured.rig.robot.name, links, joints,
        places[drawn], names, tuple(replace(one, errors_mm=one.errors_mm[drawn]) for one in sets), times,
    )  # fmt: skip


def _links(arm: Arm, q: Array, tool: Array) -> tuple[Array, Array]:
    """Corners (k, 3) mm of the links in a posture q (1, axes), from the base to the tool, and the joints (axes, 3) mm.

    Each link follows its length a, then its offset d along the axis of the joint.
    """
    frames = link_frames(arm, q)[0]
    base = frame(np.eye(3), base_places(arm, q)[0])
    corners = [base[:3, 3]]
    for before, length, here in zip([base, *frames[:-1]], arm.a, frames, strict=True):
        corners += [in_frame(before, np.array([[length, 0.0, 0.0]]))[0], here[:3, 3]]
    corners.append(in_frame(frames[-1], tool[None])[0])
    return np.array(corners), frames[:, :3, 3]


def _axis_chart(axis: AxisCurve, texts: Texts) -> Chart:
    ways: tuple[tuple[str, Role, Array], ...] = (("up", "acw", axis.up_deg), ("down", "cw", axis.down_deg))
    lines = [
        ChartLine(texts(f"turned_{way}"), role, axis.angle_deg[reached], 1e3 * off[reached], points=True)
        for way, role, off in ways
        if (reached := np.isfinite(off)).any()
    ]
    return titled_chart("axis", "targets", ("angle_of_axis", "error_of_angle"), "m°", lines, texts, axis=axis.axis)


def _cube_view(result: Result) -> tuple[Array, Array, Array, float] | None:
    """Commanded places (k, 2) mm of the cube of ISO 9283 on its plane, those of the stops (n, 2) with deviations
    (n, 2), and the side in mm.
    """
    table, rig = result.measured.table, result.measured.rig
    if not isinstance(result.found, PoseResult) or rig.tests.iso9283 is None or len(rig.robot.axes) != DRIVEN_AXES:
        return None
    cube = cube_of(rig)
    pose = poses_of_cube(table.q[result.found.rows], cube)
    if not pose.any():
        return None
    off = result.found.placed_mm[pose > 0] @ arm_of(rig.robot).T_world_base[:3, :3].T
    on_plane = np.stack([cube.level, cube.rising], axis=1)
    places = (cube.places_mm - cube.centre_mm) @ on_plane
    return places, places[pose[pose > 0] - 1], off @ on_plane, cube.side_mm
