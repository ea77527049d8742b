"""The picture of `rig postures`: error of every posture by target, joint angles of the chosen postures, and the map
of a part's places.
"""

from __future__ import annotations

import textwrap
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Rectangle

from analysis.apps.postures.report import gain_words, limits, map_words
from analysis.apps.postures.result import Postures
from analysis.apps.postures.work_map import WorkMap
from analysis.apps.report.still_chart import Part, sheet_of
from analysis.apps.report.texts import texts_of
from analysis.robot.kinematics.arm import Array

_WIDTH = 9.0
_CHOSEN, _USUAL, _GREY = "#1f5fa8", "#d95f02", "#b0b0b0"


def picture(postures: Postures) -> Figure:
    """Sheet with title, errors by target, joint angles along the program and, for a part, the map."""
    texts = texts_of("en")
    title = [gain_words(postures, texts), *limits(postures, texts)]
    parts: list[Part] = [(2.8, partial(_draw_errors, postures)), (2.6, partial(_draw_joints, postures))]
    if postures.work_map is not None:
        title.append(map_words(postures, texts))
        parts.append((5.4, partial(_draw_map, postures.work_map, postures.reached[:, :2, 3])))
    return sheet_of([short for line in title for short in textwrap.wrap(line, 92)], [], parts, _WIDTH)


def _draw_errors(postures: Postures, sheet: SubFigure) -> None:
    axes: Axes = sheet.subplots()
    targets = postures.candidates.target
    axes.plot(targets + 1, postures.errors.expected_mm, ".", color=_GREY, ms=4, label="every posture")
    for sequence, colour, label, marker in (
        (postures.usual, _USUAL, "postures of the table" if postures.is_given else "shortest way", "s"),
        (postures.best, _CHOSEN, "chosen", "o"),
    ):
        at = targets[sequence.rows] + 1
        axes.plot(at, sequence.expected_mm, "-", marker=marker, ms=3, lw=1, color=colour, label=label)
    # Single postures may be far outside the measured region.
    shown = np.concatenate([postures.best.expected_mm, postures.usual.expected_mm, np.zeros(1)])
    high = np.percentile(postures.errors.expected_mm, 95) if len(postures.errors.expected_mm) else 1.0
    axes.set_ylim(0, 1.25 * max(float(shown.max()), float(high), 1e-3))
    axes.set_xlabel("target")
    axes.set_ylabel("expected error / mm")
    axes.legend(fontsize=8, ncols=3, loc="upper right", frameon=False)


def _draw_joints(postures: Postures, sheet: SubFigure) -> None:
    axes: Axes = sheet.subplots()
    rows = postures.best.rows
    angles = np.degrees(postures.candidates.q[rows, : len(postures.rig.robot.axes)])
    for axis, column in enumerate(angles.T, start=1):
        axes.plot(postures.candidates.target[rows] + 1, column, ".-", ms=3, lw=1, label=f"J{axis}")
    axes.set_xlabel("target")
    axes.set_ylabel("chosen joint angle / °")
    axes.legend(fontsize=8, ncols=7, loc="upper right", frameon=False)
    axes.margins(y=0.25)


def _draw_map(work_map: WorkMap, places: Array, sheet: SubFigure) -> None:
    axes: Axes = sheet.subplots()
    drawn = axes.pcolormesh(work_map.x_mm, work_map.y_mm, work_map.expected_mm, cmap="viridis_r", shading="nearest")
    sheet.colorbar(drawn, ax=axes, label="expected error of the part / mm rms", shrink=0.8)
    if work_map.best_mm is not None:
        (x, y), (width, height) = work_map.best_mm, work_map.part_mm[:2]
        axes.add_patch(Rectangle((x - width / 2, y - height / 2), width, height, fill=False, ec=_CHOSEN, lw=2))
        axes.plot([], [], "-", color=_CHOSEN, lw=2, label="best place of the part")
    axes.plot(places[:, 0], places[:, 1], ".", color=_USUAL, ms=4, label="targets")
    axes.set_aspect("equal")
    axes.set_xlabel("x / mm")
    axes.set_ylabel("y / mm")
    axes.set_title(f"Centre of a part at z = {work_map.z_mm:.0f} mm; white: out of reach", fontsize=9)
    axes.legend(fontsize=8, loc="upper right")
