"""Pictures of ISO 9283: the poses of the cube with their scatter, and the paths with their deviation, enlarged."""

from __future__ import annotations

from matplotlib.axes import Axes

from analysis.measures.result_curves import PathCurve
from analysis.reporting.iso_views import PlaneView

_INK, _COMMAND = "#1f5fa8", "#777777"
_INKS = ("#d95f02", "#1f5fa8", "#1b7837", "#7d2c83", "#777777")


def draw_plane(axes: Axes, view: PlaneView, *, points: bool) -> None:
    """Commands on the inclined plane of the cube, and where the tool was; of points, P1 … P5 with their names."""
    for number, place in enumerate(view.command_mm if points else (), start=1):
        axes.annotate(f"P{number}", place, (8, 8), textcoords="offset points", fontsize=8, color=_COMMAND)
    style, size = (".", 3) if points else ("-", 1)
    axes.plot(*view.command_mm.T, "+" if points else "-", ms=12, lw=0.7, color=_COMMAND, label="commanded")
    axes.plot(*view.attained_mm.T, style, ms=size, lw=1, color=_INK, label=f"attained, {view.times:g} times enlarged")
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 1.13), ncols=2, fontsize=8, frameon=False)


def draw_along(axes: Axes, curve: PathCurve) -> None:
    """The mean deviation of each path across it, in µm, over the share of the path."""
    for name, ink in zip(dict.fromkeys(curve.path.tolist()), _INKS, strict=False):
        rows = curve.path == name
        axes.plot(100 * curve.share[rows], 1e3 * curve.at_mm[rows], "-", lw=1, color=ink, label=name.replace("_", " "))
    axes.legend(fontsize=8)
