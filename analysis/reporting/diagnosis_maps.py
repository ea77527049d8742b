"""What is left at targets, before and after: a map of the hemisphere, or pose by pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib.figure import SubFigure
from matplotlib.ticker import MaxNLocator

from analysis.inference.disagreement import Disagreement
from analysis.inference.result import Diagnosis, Map
from analysis.kinematics.arm import Array
from analysis.noise.readings import rms
from analysis.reporting.diagnosis_curves import GREY, LEFT, MEASURED

_APART_DEG = 4.0
"""Between the readings at one target and its middle, so that none hides another."""


def drawn_maps(residuals: Diagnosis | Disagreement) -> list[Map]:
    """The maps of targets with what the last model of the staircase leaves."""
    if residuals.staircase is None:
        return list(residuals.maps)
    after = [steps_um[-1] for steps_um in residuals.staircase.maps]
    return [replace(drawn, after_um=after_um) for drawn, after_um in zip(residuals.maps, after, strict=True)]


def draw_map(figure: SubFigure, target_map: Map, *, effects: bool) -> None:
    """Residuals before and, where there are effects, after, in one scale of colours."""
    if not np.isfinite(target_map.polar_deg).all():
        _draw_rows(figure, target_map, effects=effects)
        return
    sheet = figure if effects else figure.subfigures(1, 3, width_ratios=(1, 2.2, 1), squeeze=False)[0, 1]
    panels = sheet.subplots(1, 2 if effects else 1, squeeze=False)[0]
    largest = max(float(np.abs(target_map.before_um).max()), 1e-6)
    polar, azimuth = target_map.polar_deg, np.radians(target_map.azimuth_deg)
    aside = _aside(target_map.target)
    x, y = polar * np.cos(azimuth) + aside[:, 0], polar * np.sin(azimuth) + aside[:, 1]
    turn = np.linspace(0, 2 * np.pi, 181)
    for axes, values, when in zip(
        panels, (target_map.before_um, target_map.after_um), ("before", "after"), strict=False
    ):
        for ring in range(30, int(max(polar.max(), 30)) + 1, 30):
            axes.plot(ring * np.cos(turn), ring * np.sin(turn), color="#d8d8d8", lw=0.6, zorder=0)
        axes.set_aspect("equal")
        axes.set_axis_off()
        dots = axes.scatter(
            x, y, c=values, cmap="coolwarm", vmin=-largest, vmax=largest, s=26, edgecolors="#555555", linewidths=0.3
        )
        axes.set_title(f"{target_map.test}, residual {when}: rms {rms(values):.1f} µm", fontsize=9)
    sheet.colorbar(dots, ax=list(panels), label="residual / µm", shrink=0.8)
    sheet.supxlabel(
        "seen along the axis: a ring each 30° of polar angle, azimuth 0° to the right", fontsize=7.5, color=GREY
    )


def _aside(target: Array) -> Array:
    """(n, 2): the readings at one target side by side."""
    aside = np.zeros((len(target), 2))
    for number in np.unique(target):
        rows = np.flatnonzero(target == number)
        if len(rows) > 1:
            turn = 2 * np.pi * np.arange(len(rows)) / len(rows)
            aside[rows] = _APART_DEG * np.stack([np.sin(turn), np.cos(turn)], axis=1)
    return aside


def _draw_rows(figure: SubFigure, target_map: Map, *, effects: bool) -> None:
    axes = figure.subplots()
    for values, ink, when in ((target_map.before_um, MEASURED, "before"), (target_map.after_um, LEFT, "after")):
        if when == "before" or effects:
            label = f"{when}: rms {rms(values):.0f} µm"
            axes.plot(target_map.target, values, ".", ms=3, color=ink, label=label)
    distance = "of the ball from its socket" if target_map.test == "touch" else "left, pose by pose"
    axes.set_title(f"{target_map.test}: distance {distance}", fontsize=9, loc="left", fontweight="bold")
    axes.set_xlabel("row of the table", fontsize=8)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_ylabel("distance / µm", fontsize=8)
    axes.tick_params(labelsize=7.5)
    axes.legend(fontsize=8)
    axes.grid(color="#e4e4e4", lw=0.5)
    axes.spines[["top", "right"]].set_visible(False)
