"""The circles of a diagnosis: what is measured and what the models say, along the circle and around it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import SubFigure
from matplotlib.projections.polar import PolarAxes

from analysis.inference.disagreement import Disagreement
from analysis.inference.result import Curve, Diagnosis, Place
from analysis.kinematics.arm import Array
from analysis.noise.readings import rms
from analysis.reporting.diagnosis_words import runs_of, whole_lap

MEASURED, MODEL, LEFT, GREY = "#d95f02", "#1f5fa8", "#1b7f4b", "#777777"
"""Inks of measurement (less the model begun with), of the model with its effects, and of what that leaves."""
_SHADE = "#f2c14e"
_PARTS = {"distance": np.array([0.5, 0.5]), "angle": np.array([-1.0, 1.0])}
"""What of the two gauges a place is located in."""
_MOST_ROWS = 6
_NEAR_DEG = 9.0
"""Reversals nearer than this take turns in height."""


@dataclass(frozen=True)
class Strand:
    """One part of a circle's residual: phi_deg (n,) rising, steps_um (steps, n) µm of the models of a staircase, the
    first as it was begun with and the last calibrated; places: those located in it."""

    curve: Curve
    part: str
    phi_deg: Array
    steps_um: Array
    places: tuple[Place, ...]

    @property
    def before_um(self) -> Array:
        """The residual (n,) µm of the model begun with."""
        return np.asarray(self.steps_um[0])

    @property
    def after_um(self) -> Array:
        """The residual (n,) µm of the last model."""
        return np.asarray(self.steps_um[-1])

    @property
    def title(self) -> str:
        """`yaw acw, angle`."""
        return f"{runs_of(self.curve)}, {self.part}"


def strands_of(residuals: Diagnosis | Disagreement) -> tuple[list[Strand], int]:
    """A strand for each circle, of the part that disagrees more; how many circles are left out: those of least size."""
    steps = (
        residuals.staircase.curves
        if residuals.staircase
        else [np.array([curve.before_um]) for curve in residuals.curves]
    )
    strands = []
    for curve, steps_um in zip(residuals.curves, steps, strict=True):  # steps_um (steps, n, 2) µm
        phi_deg = curve.phi_deg % 360
        order = np.argsort(phi_deg)
        ordered_um = steps_um[:, order]
        places = [place for place in residuals.where if (place.test, place.direction) == (curve.test, curve.direction)]
        # The part with the worst located place; without one, the part that is larger for its noise
        worst = max(places, key=lambda place: place.sigma, default=None)
        sizes = {part: _size(ordered_um[0] @ direction, part) for part, direction in _PARTS.items()}
        part = worst.part if worst else max(sizes, key=sizes.__getitem__)
        of_part = tuple(place for place in places if place.part == part)
        strands.append(Strand(curve, part, phi_deg[order], ordered_um @ _PARTS[part], of_part))
    loudest = sorted(strands, key=lambda strand: -_size(strand.before_um, strand.part))[:_MOST_ROWS]
    chosen = {id(strand) for strand in loudest}
    return [strand for strand in strands if id(strand) in chosen], len(strands) - len(chosen)


def _size(values: Array, part: str) -> float:
    """Root mean square in units of the gauges' noise: a difference has more of it than a mean."""
    return rms(values) / float(np.linalg.norm(_PARTS[part]))


def draw_circles(figure: SubFigure, strands: Sequence[Strand], *, effects: bool) -> None:
    """A row for each strand: straight, and polar. effects: whether there is a model after."""
    rows = figure.subfigures(len(strands), 1, squeeze=False)[:, 0]
    for place, (row, strand) in enumerate(zip(rows, strands, strict=True)):
        straight, around = row.subfigures(1, 2, width_ratios=(2.6, 1))
        panels = straight.subplots(2 if effects else 1, 1, sharex=True, squeeze=False)[:, 0]
        _draw_readings(panels[0], strand, effects=effects, named=place == 0)
        if effects:
            after = panels[1]
            after.axhline(0.0, color=GREY, lw=0.6)
            after.plot(strand.phi_deg, strand.before_um, color=MEASURED, lw=0.7, alpha=0.45, label="residual before")
            after.plot(strand.phi_deg, strand.after_um, color=LEFT, lw=0.9, label="residual after")
            after.set_ylabel("residual / µm", fontsize=8)
            if place == 0:
                _legend(after, 2)
        for axes in panels:
            _draw_marks(axes, strand, numbered=axes is panels[0])
        panels[-1].set_xlabel("circle angle φ / °" if place == len(strands) - 1 else "", fontsize=8)
        _draw_polar(around.add_subplot(projection="polar"), strand, effects=effects)


def _draw_readings(axes: Axes, strand: Strand, *, effects: bool, named: bool) -> None:
    axes.plot(strand.phi_deg, strand.before_um, color=MEASURED, lw=2.2 if effects else 1.0, alpha=0.7, label="measured")
    axes.axhline(0.0, color=GREY, lw=1.2, label="model begun with")
    if effects:
        explained = strand.before_um - strand.after_um
        axes.plot(strand.phi_deg, explained, color=MODEL, lw=0.9, label="model with all parts")
    after = f" → {rms(strand.after_um):.1f}" if effects else ""
    title = f"{strand.title}: residual {rms(strand.before_um):.1f}{after} µm rms"
    axes.set_title(title, fontsize=9, loc="left", fontweight="bold")
    axes.set_ylabel("less the model\nbegun with / µm", fontsize=8)
    # Room above the curve for the joints' numbers
    low, high = float(strand.before_um.min()), float(strand.before_um.max())
    span = max(high - low, 1e-6)
    axes.set_ylim(low - 0.08 * span, high + 0.5 * span)
    if named:
        _legend(axes, 3)


def _legend(axes: Axes, columns: int) -> None:
    axes.legend(fontsize=7, ncols=columns, loc="lower right", bbox_to_anchor=(1.0, 1.0), frameon=False, borderpad=0)


def _draw_marks(axes: Axes, strand: Strand, *, numbered: bool) -> None:
    axes.set_xlim(0, 360)
    axes.set_xticks(range(0, 361, 30))
    axes.tick_params(labelsize=7.5)
    axes.grid(color="#e4e4e4", lw=0.5)
    axes.spines[["top", "right"]].set_visible(False)
    for low, high in _stretches(strand.places):
        axes.axvspan(low, high, color=_SHADE, alpha=0.35, lw=0, zorder=0)
    for phi, joint, step in _staggered(strand.curve.turns):
        axes.axvline(phi, color=GREY, lw=0.7, ls=":")
        if numbered:
            axes.annotate(
                str(joint),
                (phi, 1.0 - 0.11 * step),
                xycoords=("data", "axes fraction"),
                xytext=(2, -2),
                textcoords="offset points",
                fontsize=7.5,
                color=GREY,
                va="top",
                ha="right" if phi > 354 else "left",
            )


def _staggered(turns: Sequence[tuple[float, int]]) -> list[tuple[float, int, int]]:
    """Reversals (circle angle, joint) by angle, with a step 0, 1 or 2 by which near numbers part."""
    staggered: list[tuple[float, int, int]] = []
    for phi, joint in sorted(turns):
        near = bool(staggered) and phi - staggered[-1][0] < _NEAR_DEG
        staggered.append((phi, joint, (staggered[-1][2] + 1) % 3 if near else 0))
    return staggered


def _stretches(places: Sequence[Place]) -> list[tuple[float, float]]:
    """Where to shade; a stretch over φ = 0° is two, and of a whole lap nothing is shaded."""
    stretches = []
    for place in places:
        if whole_lap(place):
            continue
        low, high = place.from_deg, place.to_deg
        stretches += [(low, high)] if low <= high else [(low, 360.0), (0.0, high)]
    return stretches


def _draw_polar(axes: PolarAxes, strand: Strand, *, effects: bool) -> None:
    """The residual drawn outwards from a circle, as a roundness plot has it."""
    largest = max(float(np.abs(strand.before_um).max()), 1e-6)
    turn = np.radians(np.append(strand.phi_deg, strand.phi_deg[:1] + 360.0))
    axes.plot(turn, np.zeros_like(turn), color=GREY, lw=0.8)
    axes.plot(turn, np.append(strand.before_um, strand.before_um[:1]), color=MEASURED, lw=0.8)
    if effects:
        axes.plot(turn, np.append(strand.after_um, strand.after_um[:1]), color=LEFT, lw=0.9)
    axes.set_rlim(-2.6 * largest, 1.9 * largest)
    for low, high in _stretches(strand.places):
        axes.bar(
            np.radians((low + high) / 2), 4.5 * largest, width=np.radians(high - low), bottom=-2.6 * largest,
            color=_SHADE, alpha=0.35, lw=0, zorder=0,
        )  # fmt: skip
    for phi, joint, step in _staggered(strand.curve.turns):
        axes.plot(np.radians([phi, phi]), [-largest, 1.15 * largest], color=GREY, lw=0.6, ls=":")
        out = (1.32 + 0.3 * step) * largest
        axes.text(np.radians(phi), out, str(joint), fontsize=7, color=GREY, ha="center", va="center")
    axes.set_xticks(np.radians(range(0, 360, 90)), [f"{angle}°" for angle in range(0, 360, 90)], fontsize=7)
    axes.tick_params(pad=-1)
    axes.set_yticks([0.0, largest], ["", f"+{largest:.{0 if largest >= 10 else 1}f} µm"], fontsize=6.5, color=GREY)
    axes.set_rlabel_position(67.0)
    axes.grid(color="#e4e4e4", lw=0.5)
    axes.spines["polar"].set_visible(False)
