"""Pictures of circle runs, after the paper's figures 3 (raw with the fitted sine) and 6 (orientation error)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.circle import Reversal, frame_of, reversals
from analysis.kinematics.arm import arm_of
from analysis.programs import circle_of
from analysis.results import Result

_INK = {"acw": "#d95f02", "cw": "#1f5fa8"}
_GREY = "#777777"


def save_pictures(results: Sequence[Result], directory: Path) -> list[Path]:
    """Write raw.png and error.png of runs of one circle; returns their paths."""
    pictures = {"raw.png": raw_figure(results), "error.png": error_figure(results)}
    written = []
    for name, figure in pictures.items():
        figure.savefig(directory / name, dpi=150)
        written.append(directory / name)
    return written


def raw_figure(results: Sequence[Result]) -> Figure:
    """Angle over circle angle with its least-squares sine, a panel for each run (the paper's figure 3)."""
    figure, panels = _panels(results, "Yaw angle and least-squares sine")
    for result, axes in zip(results, panels, strict=True):
        yaw = result.yaw
        phi = np.degrees(yaw.phi) % 360
        axes.plot(phi, np.degrees(yaw.angle), ".", ms=2, color=_INK[yaw.lap.direction], label="measured")
        whole = np.linspace(0, 2 * np.pi, 361)
        sine = f"sine, amplitude {yaw.figures['amplitude_deg']}"
        axes.plot(np.degrees(whole), np.degrees(yaw.sine(whole)), "-", lw=1, color="black", label=sine)
        axes.set_ylabel(f"{yaw.lap.direction}: yaw / °")
        axes.legend(loc="upper left", fontsize=8, framealpha=0.9)
    return figure


def error_figure(results: Sequence[Result]) -> Figure:
    """Orientation error with its band and the joints' reversals, a panel for each run (figure 6)."""
    figure, panels = _panels(results, "Orientation error in yaw")
    low, high = _common_range(results)
    for result, axes in zip(results, panels, strict=True):
        yaw = result.yaw
        order = np.argsort(np.degrees(yaw.phi) % 360)
        error = np.degrees(yaw.residual)
        axes.plot((np.degrees(yaw.phi) % 360)[order], error[order], "-", lw=1, color=_INK[yaw.lap.direction])
        axes.axhspan(error.min(), error.max(), color=_INK[yaw.lap.direction], alpha=0.08, lw=0)
        axes.set_ylim(low, high)
        axes.set_ylabel(f"{yaw.lap.direction}: error / °")
        band = f"error band {yaw.figures['band_deg']}"
        axes.text(0.01, 0.04, band, transform=axes.transAxes, fontsize=9, va="bottom")
        _mark_reversals(axes, result)
    return figure


def _panels(results: Sequence[Result], title: str) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(9, 1.2 + 2.6 * len(results)), layout="constrained")
    panels: list[Axes] = list(figure.subplots(len(results), 1, sharex=True, squeeze=False)[:, 0])
    figure.suptitle(f"{title} · {results[0].data.rig.name}", fontsize=11)
    for axes in panels:
        axes.set_xlim(0, 360)
        axes.set_xticks(range(0, 361, 30))
        axes.grid(color="#dddddd", lw=0.5)
        axes.spines[["top", "right"]].set_visible(False)
    panels[-1].set_xlabel("circle angle φ / °")
    return figure, panels


def _common_range(results: Sequence[Result]) -> tuple[float, float]:
    """One scale for all panels, with room for the marks above and the band's text below."""
    low = min(float(np.degrees(result.yaw.residual).min()) for result in results)
    high = max(float(np.degrees(result.yaw.residual).max()) for result in results)
    return low - 0.28 * (high - low), high + 0.3 * (high - low)


def _mark_reversals(axes: Axes, result: Result) -> None:
    """A dashed line where a joint turns back; names of close neighbours take turns in height."""
    rig = result.data.rig
    circle = circle_of(rig)
    turns = reversals(frame_of(circle), arm_of(rig.robot), np.radians(circle.posture_deg), rig.name)
    previous, step = -100.0, 0
    for turn in sorted(turns, key=lambda turn: turn.phi):
        phi = float(np.degrees(turn.phi))
        step = (step + 1) % 3 if phi - previous < 16 else 0
        axes.axvline(phi, color=_GREY, lw=0.7, ls="--")
        axes.annotate(
            _name(result, turn),
            (phi, 1.0 - 0.085 * step),
            xycoords=("data", "axes fraction"),
            xytext=(2, -2),
            textcoords="offset points",
            fontsize=7.5,
            color=_GREY,
            va="top",
            ha="right" if phi > 345 else "left",
        )
        previous = phi


def _name(result: Result, turn: Reversal) -> str:
    return f"{result.data.rig.robot.axes[turn.axis - 1].name} {'↓' if turn.upper else '↑'}"
