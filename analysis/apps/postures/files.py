"""Files of `rig postures`: the chosen postures as tables, program and picture."""

from __future__ import annotations

import textwrap
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Rectangle

from analysis.apps.makers.motion_plan import Comment, JointMove, MotionPlan, Step, demand_of
from analysis.apps.makers.writing import encoded_programs, programs_of
from analysis.apps.postures.report import POSTURE_COLUMNS, all_csv, chosen_csv, doubt_lines, gain_words, map_words
from analysis.apps.postures.result import Postures, Sequence, WorkMap
from analysis.apps.postures.targets import labels_of
from analysis.apps.programs.planned import targets_at, tracker_plan
from analysis.apps.programs.target_path import POSES, TargetPath
from analysis.apps.report.chart import Chart, ChartLine, Part, Role, as_png, sheet_of
from analysis.apps.report.texts import texts_of
from analysis.robot.kinematics.arm import Array, arm_of
from analysis.runs.written_files import Writer, holding, write_all_new
from rigs.errors import FileError
from rigs.schema.vocabulary import MakerName

_SPEED_RAD_S = float(np.radians(20.0))
"""Speed of the fastest joint between targets, as in the programs of tests: slow enough to be stopped by hand."""


def write_postures(postures: Postures, read: TargetPath, directory: Path, maker: MakerName | None = None) -> list[Path]:
    """Write the tables, the picture, and the program of a maker into a directory: all files or none."""
    replaced = {*read.names, *POSES, *POSTURE_COLUMNS}
    kept = {name: column for name, column in read.columns.items() if name not in replaced}
    files: dict[str, Writer] = {
        "postures.csv": holding(chosen_csv(postures, kept).encode()),
        "all-postures.csv": holding(all_csv(postures, labels_of(read)).encode()),
        "postures.png": as_png(lambda: picture(postures)),
    }
    if maker:
        plan = posture_plan(postures, labels_of(read))
        files |= encoded_programs(maker, programs_of(maker, [(plan, demand_of(plan))]))
    try:
        return write_all_new(directory, files)
    except FileError as error:
        raise FileError(error.where, error.what, "give another --output", code=error.code) from None


def posture_plan(postures: Postures, labels: list[str]) -> MotionPlan:
    """Plan that moves the joints to the chosen posture of each target in turn and stops there."""
    rows = postures.best.rows
    targets = targets_at(arm_of(postures.rig.robot), postures.candidates.q[rows])
    steps: list[Step] = []
    for number, target in zip(postures.candidates.target[rows].tolist(), targets, strict=True):
        steps += [Comment(labels[number]), JointMove(target, _SPEED_RAD_S)]
    return tracker_plan(postures.rig, f"postures {postures.rig.name}", steps)


# ----------------------------------------------------------------------------------------------------------------------
# The picture: errors by target, joint angles along the program and, for a part, the map.

_BEST, _TARGETS = "#1f5fa8", "#d95f02"
_JOINTS: tuple[Role, ...] = ("acw", "cw", "measured", "after", "quiet", "fifth", "sixth")


def picture(postures: Postures) -> Figure:
    """Sheet with title, errors by target, joint angles along the program and, for a part, the map."""
    texts = texts_of("en")
    title, parts = [gain_words(postures, texts), *doubt_lines(postures, texts)], list[Part]()
    if postures.work_map is not None:
        title.append(map_words(postures, texts))
        parts.append((5.4, partial(_draw_map, postures.work_map, postures.reached[:, :2, 3])))
    lines = [short for line in title for short in textwrap.wrap(line, 92)]
    return sheet_of(lines, [_errors(postures), _joints(postures)], parts)


def _errors(postures: Postures) -> Chart:
    expected, target = postures.errors.expected_mm, postures.candidates.target.astype(float) + 1.0
    usual = "postures of the table" if postures.is_given else "shortest way"
    sequences: list[tuple[str, Role, Sequence]] = [(usual, "acw", postures.usual), ("chosen", "cw", postures.best)]
    lines = [ChartLine("every posture", "quiet", target, expected, points=True)]
    lines += [ChartLine(name, role, target[one.rows], one.expected_mm) for name, role, one in sequences]
    # Single postures may be far outside the measured region.
    high = np.percentile(expected, 95) if len(expected) else 1.0
    span = (0.0, 1.25 * max(*(line.y.max(initial=1e-3) for line in lines[1:]), float(high)))
    labels = "target", "expected error / mm"
    return Chart("Expected error", "", "targets", *labels, "mm", tuple(lines), span=span)


def _joints(postures: Postures) -> Chart:
    rows = postures.best.rows
    angles = np.degrees(postures.candidates.q[rows, : len(postures.rig.robot.axes)])
    lines = [
        ChartLine(f"J{axis}", role, postures.candidates.target[rows].astype(float) + 1.0, column)
        for axis, (role, column) in enumerate(zip(_JOINTS, angles.T, strict=False), start=1)
    ]
    return Chart("Chosen postures", "", "targets", "target", "joint angle / °", "°", tuple(lines))


def _draw_map(work_map: WorkMap, places: Array, sheet: SubFigure) -> None:
    axes: Axes = sheet.subplots()
    drawn = axes.pcolormesh(work_map.x_mm, work_map.y_mm, work_map.expected_mm, cmap="viridis_r", shading="nearest")
    sheet.colorbar(drawn, ax=axes, label="expected error of the part / mm rms", shrink=0.8)
    if work_map.best_mm is not None:
        (x, y), (width, height) = work_map.best_mm, work_map.part_mm[:2]
        axes.add_patch(Rectangle((x - width / 2, y - height / 2), width, height, fill=False, ec=_BEST, lw=2))
        axes.plot([], [], "-", color=_BEST, lw=2, label="best place of the part")
    axes.plot(places[:, 0], places[:, 1], ".", color=_TARGETS, ms=4, label="targets")
    axes.set_aspect("equal")
    axes.set_xlabel("x / mm")
    axes.set_ylabel("y / mm")
    axes.set_title(f"Centre of a part at z = {work_map.z_mm:.0f} mm; white: out of reach", fontsize=9)
    axes.legend(fontsize=8, loc="upper right")
