"""Charts with the title and caption of a text key."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.apps.report.chart import Chart, ChartLine, Frame, Role
from analysis.apps.report.texts import Texts
from analysis.robot.kinematics.arm import Array

_SHARE = 0.12
"""Length of the largest deviation on a plane, as a share of the side of the cube."""


def titled_chart(
    key: str, frame: Frame, labels: tuple[str, str], unit: str, lines: Sequence[ChartLine], texts: Texts,
    **values: object,
) -> Chart:  # fmt: skip
    """A chart with the title and caption of a key. labels: text keys of both axes."""
    title, caption = texts(f"chart_{key}", **values), texts(f"caption_{key}", **values)
    return Chart(title, caption, frame, texts(labels[0]), texts(labels[1]), unit, tuple(lines))


def plane_chart(
    title: str, command: Array, places: Array, off: Array, side_mm: float, texts: Texts, *, points: bool
) -> Chart:
    """Positions (n, 2) mm on the plane of the cube, with magnified deviations `off`; gaps between paths are nan."""
    largest = max(float(np.nanmax(np.linalg.norm(off, axis=1))), 1e-9)
    times = float(f"{_SHARE * side_mm / largest:.1g}")
    positions: tuple[tuple[str, Role, Array], ...] = (
        ("attained", "cw", places + times * off), ("commanded", "quiet", command),
    )  # fmt: skip
    lines = tuple(ChartLine(texts(name), role, xy[:, 0], xy[:, 1], points=points) for name, role, xy in positions)
    labels = f"{texts('level')} / mm", f"{texts('rising')} / mm"
    return Chart(texts(title), texts("caption_plane", times=f"{times:g}"), "plane", *labels, "mm", lines)
