"""Figures of Oh 2019 drawn from the simulated robot, with the published and the simulated numbers below each.

Figures 3 to 8 show yaw, 10 and 11 roll, 13 and 14 the hemisphere, and 15 the repeatability. Figures 1, 2, 9 and 12 show
equipment and are omitted.

Figures of measurements (3, 5, 6, 10, 13, 15) include all effects of the rig file. Figures of the paper's simulations
include only the effects named in the paper: eccentricity (4), datum errors and backlash (8), gear errors (14). All runs
are simulated and evaluated in the usual way.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import BinaryIO

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase

from analysis.api import CircleCurve, RadialCurve, RepeatabilityCurve, Result, evaluate
from analysis.apps.paper.published import NOMINAL_RADIUS_MM, datum_and_play, gears
from analysis.apps.paper.rows import DIRECTIONS, PaperRow, eccentric, written
from analysis.apps.paper.simulated_tests import SCATTER, joint_lap, repeats, typical_seed
from analysis.apps.report.still_chart import Sheet
from analysis.procedures.simulate import simulated_run
from analysis.robot.kinematics.arm import Array
from rigs.effects import Effect
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction, TestName


@dataclass(frozen=True)
class SimulatedFigures:
    """Evaluated runs, by the figures drawn from them."""

    yaw: dict[Direction, Result]
    eccentric: Result
    joints: tuple[Array, Array, tuple[str, ...]]
    """Circle angles (n,) and reported joint angles (n, 6) in degrees on a lap, and the axis names."""
    yaw_datum_and_play: dict[Direction, Result]
    roll: dict[Direction, Result]
    sphere: Result
    sphere_gears: Result
    repeatability: Result
    """The only run with noise."""


def figures_of(rig: Rig, rig_text: str) -> SimulatedFigures:
    """Simulate all runs. Raises FileError if the robot cannot run a test."""

    def result(test: TestName, direction: Direction | None, effects: Sequence[Effect], of: Rig = rig) -> Result:
        return evaluate(simulated_run(of, rig_text, test, direction, None, effects))

    def both(test: TestName, effects: Sequence[Effect]) -> dict[Direction, Result]:
        return {direction: result(test, direction, effects) for direction in DIRECTIONS}

    seed = typical_seed(repeats(rig, rig.effects))
    phi, q = joint_lap(rig)
    return SimulatedFigures(
        yaw=both("yaw", rig.effects),
        eccentric=result("yaw", "acw", (), eccentric(rig)),
        joints=(np.degrees(phi), np.degrees(q), tuple(axis.name for axis in rig.robot.axes)),
        yaw_datum_and_play=both("yaw", datum_and_play(rig.effects)),
        roll=both("roll", rig.effects),
        sphere=result("radial", None, rig.effects),
        sphere_gears=result("radial", None, gears(rig.effects)),
        repeatability=evaluate(simulated_run(rig, rig_text, "repeatability", None, seed, noise=SCATTER)),
    )


_INK = {"acw": "#d95f02", "cw": "#1f5fa8"}
_GREY = "#777777"
_ARROW = {"arrowstyle": "-|>", "lw": 2.0, "color": "black"}
_MAGNIFIED = 100
"""Magnification of deviations. At true scale, a deviation of millimetres is invisible on a sphere of 400 mm."""


def save(rig: Rig, rig_text: str, rows: Sequence[PaperRow], directory: Path) -> list[Path]:
    """Write the pictures to a directory; file names contain the figure numbers of the paper.

    Raises FileError if a picture cannot be written.
    """
    from analysis.runs.written_files import write_views  # noqa: PLC0415 - slow to import

    simulated = figures_of(rig, rig_text)

    def save_figure(number: int, file: BinaryIO) -> None:
        _, title, draw, height_inch = _FIGURES[number]
        # Figures 4 and 7 also show the rows of their section and table.
        where = {4: "§2.1", 7: "Table 1"}.get(number, f"Fig. {number}")
        rows_of_figure = [row for row in rows if row.where == where]
        figure = _sheet(f"Figure {number} · {title} · {rig.name}", rows_of_figure, height_inch)
        draw(figure.subfigs[0], simulated)
        figure.savefig(file, format="png", dpi=150)

    names = {number: f"figure-{number:02d}-{name}.png" for number, (name, *_) in _FIGURES.items()}
    return write_views(directory, {name: partial(save_figure, number) for number, name in names.items()})


def _sheet(title: str, rows: Sequence[PaperRow], height_inch: float) -> Sheet:
    """An empty subfigure for the drawing, and a table of the rows below it."""
    rows_inch = 0.24 * (len(rows) + 1) + 0.1
    sheet = Sheet(9, height_inch + rows_inch)
    sheet.suptitle(title, fontsize=11)
    grid = sheet.add_gridspec(2, 1, height_ratios=(height_inch, rows_inch))
    _, below = (sheet.add_subfigure(cell) for cell in (grid[0], grid[1]))
    axes = below.subplots()
    axes.set_axis_off()
    if not rows:
        axes.text(0.5, 0.5, "the paper gives no number for this figure", ha="center", va="center", fontsize=8)
        return sheet
    cells = [[row.figure, written(row, row.paper), written(row, row.ours)] for row in rows]
    table = axes.table(
        cells, colLabels=["", "paper", "ours"], colWidths=(0.5, 0.2, 0.2), loc="center", edges="horizontal"
    )
    table.auto_set_font_size(False)
    table.set_fontsize(8)
    for (_, column), cell in table.get_celld().items():
        cell.set_edgecolor("#dddddd")
        cell.set_text_props(ha="left" if column == 0 else "right")
    return sheet


def _circle_panels(figure: FigureBase, count: int, y: str) -> list[Axes]:
    panels: list[Axes] = list(figure.subplots(count, 1, sharex=True, sharey=True, squeeze=False)[:, 0])
    for axes in panels:
        _label_axes(axes, "", y)
        axes.set_xlim(0, 360)
        axes.set_xticks(range(0, 361, 30))
    panels[-1].set_xlabel("circle angle φ / °")
    return panels


def _curve(result: Result) -> CircleCurve:
    assert isinstance(result.curve, CircleCurve)  # noqa: S101 - of a circle
    return result.curve


def _sine_deg(result: Result) -> Array:
    """Least-squares sine (n,) deg of a run at the circle angles of the curve."""
    amplitude, shift, offset = (result.figures[f"{name}_deg"].value for name in ("amplitude", "shift", "offset"))
    return offset + amplitude * np.sin(np.radians(_curve(result).phi_deg + shift))


def _raw(figure: FigureBase, simulated: SimulatedFigures) -> None:
    """Figure 3: angle in each direction, with the least-squares sine."""
    for axes, direction in zip(_circle_panels(figure, 2, "yaw angle / °"), DIRECTIONS, strict=True):
        result = simulated.yaw[direction]
        curve = _curve(result)
        axes.plot(curve.phi_deg, curve.angle_deg, color=_INK[direction], lw=1.2, label=direction)
        sine = f"least-squares sine, amplitude {result.figures['amplitude_deg'].value:.3f}°"
        axes.plot(curve.phi_deg, _sine_deg(result), "k--", lw=0.8, label=sine)
        axes.legend(loc="upper left", fontsize=8)


def _eccentric(figure: FigureBase, simulated: SimulatedFigures) -> None:
    """Figure 4: angle caused only by an eccentricity."""
    (axes,) = _circle_panels(figure, 1, "yaw angle / °")
    curve = _curve(simulated.eccentric)
    axes.plot(curve.phi_deg, curve.angle_deg, color=_INK["acw"], lw=1.2)
    for end in (-1, 1):
        axes.axhline(end * np.abs(curve.angle_deg).max(), color=_GREY, lw=0.7, ls="--")


def _fitted(figure: FigureBase, simulated: SimulatedFigures) -> None:
    """Figure 5: the least-squares sine, and the deviation of every tenth point."""
    (axes,) = _circle_panels(figure, 1, "yaw angle / °")
    result = simulated.yaw["cw"]
    curve, sine = _curve(result), _sine_deg(result)
    every_tenth = slice(None, None, 10)
    axes.plot(curve.phi_deg, sine, "k-", lw=1, label="least-squares sine  A + r sin(φ + α)")
    axes.plot(
        curve.phi_deg[every_tenth], curve.angle_deg[every_tenth], "o", ms=3, color=_INK["cw"], label="cw, every 5°"
    )
    axes.vlines(curve.phi_deg[every_tenth], sine[every_tenth], curve.angle_deg[every_tenth], color=_INK["cw"], lw=0.8)
    axes.legend(loc="upper left", fontsize=8)


def _errors(figure: FigureBase, results: Mapping[Direction, Result]) -> None:
    for axes, direction in zip(_circle_panels(figure, 2, "orientation error / °"), DIRECTIONS, strict=True):
        result = results[direction]
        error = _curve(result).error_deg
        axes.plot(_curve(result).phi_deg, error, color=_INK[direction], lw=1.2)
        axes.axhspan(error.min(), error.max(), color=_INK[direction], alpha=0.08, lw=0)
        axes.set_title(f"{direction}, error band {result.figures['band_deg'].value:.3f}°", fontsize=9, loc="left")
        axes.margins(y=0.3)
        # A dashed line marks each joint reversal. The labels of close neighbours are staggered in height.
        previous, step = -100.0, 0
        for turn in result.reversals:
            phi = turn.phi_deg
            step = (step + 1) % 3 if phi - previous < 16 else 0
            axes.axvline(phi, color=_GREY, lw=0.7, ls="--")
            axes.annotate(
                f"axis {turn.joint} {'↓' if turn.upper else '↑'}",
                (phi, 1.0 - 0.085 * step),
                xycoords=("data", "axes fraction"),
                xytext=(-3 if phi > 345 else 2, -2),
                textcoords="offset points",
                fontsize=7.5,
                color=_GREY,
                va="top",
                ha="right" if phi > 345 else "left",
            )
            previous = phi


def _joints(figure: FigureBase, simulated: SimulatedFigures) -> None:
    """Figure 7: joint angles on the circle. As in the paper, a square marks each reversal."""
    phi_deg, angles_deg, names = simulated.joints
    panels = list(figure.subplots(3, 2, sharex=True).flat)
    for axes, name, q_deg in zip(panels, names, angles_deg.T, strict=True):
        _label_axes(axes, "", f"{name} / °")
        axes.plot(phi_deg, q_deg, color=_INK["cw"], lw=1.2)
        axes.set_xlim(0, 360)
        axes.set_xticks(range(0, 361, 60))
        axes.margins(y=0.25)
        turns = [turn for turn in simulated.yaw["acw"].reversals if turn.name == name]
        for turn in turns:
            at = (turn.phi_deg, float(np.interp(turn.phi_deg, phi_deg, q_deg)))
            axes.plot(*at, "s", ms=8, mfc="none", mec="black", mew=1.4, clip_on=False)
            style = {"xytext": (-7 if turn.phi_deg > 300 else 7, 9 if turn.upper else -14), "fontsize": 8}
            side = "right" if turn.phi_deg > 300 else "left"
            axes.annotate(f"{turn.phi_deg:.1f}°", at, textcoords="offset points", ha=side, **style)
        if not turns:
            axes.text(0.5, 0.9, "does not turn back", transform=axes.transAxes, ha="center", fontsize=8, color=_GREY)
    for axes in panels[-2:]:
        axes.set_xlabel("circle angle φ / °")


def _roll(figure: FigureBase, simulated: SimulatedFigures) -> None:
    """Figure 10: roll angle in each direction. As in the paper, no sine is removed."""
    for axes, direction in zip(_circle_panels(figure, 2, "roll angle / °"), DIRECTIONS, strict=True):
        curve = _curve(simulated.roll[direction])
        axes.plot(curve.phi_deg, curve.angle_deg, color=_INK[direction], lw=1.2)
        axes.set_title(direction, fontsize=9, loc="left")


def _roll_mean(figure: FigureBase, simulated: SimulatedFigures) -> None:
    """Figure 11: mean roll angle of both directions."""
    (axes,) = _circle_panels(figure, 1, "roll angle / °")
    curves = [_curve(simulated.roll[direction]) for direction in DIRECTIONS]
    mean_deg = np.mean([curve.angle_deg for curve in curves], axis=0)
    axes.plot(curves[0].phi_deg, mean_deg, color="black", lw=1.2)
    for at in (np.argmax(mean_deg), np.argmin(mean_deg)):
        axes.plot(curves[0].phi_deg[at], mean_deg[at], "o", color=_INK["acw"], ms=5)


def _radial(figure: FigureBase, result: Result) -> None:
    """Draw the radial errors of the targets: side view, top view, and over the azimuth.

    The side view is perpendicular to the displacement of the sphere. Over the azimuth, a displacement appears as one
    full wave.
    """
    curve = result.curve
    assert isinstance(curve, RadialCurve)  # noqa: S101 - of a hemisphere
    polar, azimuth = np.radians(curve.polar_deg), np.radians(curve.azimuth_deg)
    ways = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)])
    centre = np.array([result.figures[f"centre_{name}_mm"].value for name in "xyz"])
    radius_mm = result.figures["radius_mm"].value
    # Distance of a target from the nominal sphere about the ball, positive outside. First order is sufficient for
    # millimetres on a radius of 400 mm.
    error_mm = radius_mm - NOMINAL_RADIUS_MM + centre @ ways + curve.deviation_mm
    pulled_deg = float(np.degrees(np.arctan2(centre[1], centre[0])))
    side, above, wave = figure.subplots(1, 3, width_ratios=(1.5, 0.85, 1.05))
    _draw_side(side, ways, error_mm, centre, radius_mm)
    _draw_above(above, curve, error_mm, pulled_deg)
    around_deg = (curve.azimuth_deg - pulled_deg + 180) % 360 - 180
    for ring in np.unique(curve.polar_deg[curve.polar_deg > 0]):
        ring_rows = np.flatnonzero(curve.polar_deg == ring)
        ring_rows = ring_rows[np.argsort(around_deg[ring_rows])]
        wave.plot(around_deg[ring_rows], error_mm[ring_rows], "o-", ms=4, lw=1.0, label=f"{ring:.0f}° from the axis")
    wave.axhline(0, color="black", lw=0.8)
    wave.set_xticks(range(-180, 181, 90))
    _label_axes(wave, "azimuth from the side pulled to / °", "outside the nominal sphere / mm")
    wave.legend(fontsize=7)
    wave.set_title("largest on that side, smallest on the other", fontsize=8)


def _draw_side(axes: Axes, ways: Array, error_mm: Array, centre_mm: Array, radius_mm: float) -> None:
    """Draw the side view: targets, nominal sphere and least-squares sphere, with magnified errors.

    ways (3, t): directions of the targets. error_mm (t,), centre_mm (3,).
    """
    along = np.array([centre_mm[0], centre_mm[1], 0.0]) / max(float(np.hypot(*centre_mm[:2])), 1e-12)
    turn = np.linspace(-np.pi / 2, np.pi / 2, 181)
    outline = np.stack([np.sin(turn), np.cos(turn)])
    nominal = NOMINAL_RADIUS_MM * outline
    axes.plot(*nominal, "--", color=_GREY, lw=1.2, label="nominal sphere about the ball")
    shift = _MAGNIFIED * np.array([centre_mm @ along, centre_mm[2]])
    drawn_mm = NOMINAL_RADIUS_MM + _MAGNIFIED * (radius_mm - NOMINAL_RADIUS_MM)
    axes.plot(*(drawn_mm * outline + shift[:, None]), "k-", lw=1.2, label="least-squares sphere")
    seen = np.stack([along @ ways, ways[2]])
    begin, end = NOMINAL_RADIUS_MM * seen, (NOMINAL_RADIUS_MM + _MAGNIFIED * error_mm) * seen
    axes.plot(np.stack([begin[0], end[0]]), np.stack([begin[1], end[1]]), "-", color="red", lw=0.8)
    axes.plot(*end, "o", color="red", ms=3, label=f"targets, errors × {_MAGNIFIED}")
    axes.annotate(
        "",
        (float(shift[0]), float(shift[1])),
        (0.0, 0.0),
        arrowprops={"arrowstyle": "-|>", "lw": 2.0, "color": "black"},
    )
    axes.plot(0, 0, "+", color=_GREY, ms=10)
    axes.set_aspect("equal")
    axes.set_ylim(-60, 1.2 * NOMINAL_RADIUS_MM)
    _label_axes(axes, "to the side pulled to / mm", "along the axis / mm")
    axes.legend(fontsize=6.5, loc="upper center", bbox_to_anchor=(0.5, -0.3), ncols=1, frameon=False)
    axes.set_title(f"from the side: pulled by {np.linalg.norm(centre_mm):.2f} mm", fontsize=8)


def _draw_above(axes: Axes, curve: RadialCurve, error_mm: Array, pulled_deg: float) -> None:
    """Draw the errors on the hemisphere from above, with an arrow in the direction of the displacement."""
    azimuth, limit = np.radians(curve.azimuth_deg), float(np.abs(error_mm).max())
    x, y = curve.polar_deg * np.cos(azimuth), curve.polar_deg * np.sin(azimuth)
    axes.scatter(x, y, c=error_mm, cmap="coolwarm", vmin=-limit, vmax=limit, s=60, edgecolors="#555555", linewidths=0.4)
    turn = np.linspace(0, 2 * np.pi, 181)
    for ring in (30, 60, 90):
        axes.plot(ring * np.cos(turn), ring * np.sin(turn), color="#dddddd", lw=0.6, zorder=0)
    tip = 112 * float(np.cos(np.radians(pulled_deg))), 112 * float(np.sin(np.radians(pulled_deg)))
    axes.annotate("", tip, (0.0, 0.0), arrowprops=_ARROW)
    axes.set_xlim(-120, 120)
    axes.set_ylim(-120, 120)
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_title(f"from above: red outside,\nblue inside, at most {limit:.2f} mm", fontsize=8)


def _repeatability(figure: FigureBase, simulated: SimulatedFigures) -> None:
    """Figure 15: readings at each target, by side of approach."""
    curve = simulated.repeatability.curve
    assert isinstance(curve, RepeatabilityCurve)  # noqa: S101 - of a repeatability test
    axes = figure.subplots()
    targets, place = np.unique(curve.target, return_inverse=True)
    for side, aside, ink, name in (("out", -0.12, "acw", "from outside"), ("in", 0.12, "cw", "from inside")):
        on_side = curve.approach == side
        axes.plot(place[on_side] + aside, curve.reading_mm[on_side], "o", ms=4, color=_INK[ink], label=name)
    axes.set_xticks(range(len(targets)), [str(target) for target in targets])
    _label_axes(axes, "target", "reading / mm")
    axes.legend(fontsize=8)


_FIGURES: dict[int, tuple[str, str, Callable[[FigureBase, SimulatedFigures], None], float]] = {
    3: ("yaw-angle", "yaw angle and its least-squares sine", _raw, 5.0),
    4: ("eccentricity", "angle by an eccentricity of 14.142 mm", _eccentric, 3.0),
    5: ("least-squares-sine", "least-squares sine and residual", _fitted, 3.4),
    6: ("yaw-error", "orientation error in yaw, all effects", lambda figure, made: _errors(figure, made.yaw), 5.4),
    7: ("joint-angles", "joint angles on the circle", _joints, 6.0),
    8: (
        "yaw-simulated",
        "orientation error in yaw, datum errors and plays",
        lambda figure, made: _errors(figure, made.yaw_datum_and_play),
        5.4,
    ),
    10: ("roll-error", "roll, all effects", _roll, 5.0),
    11: ("roll-simulated", "roll, mean of cw and acw", _roll_mean, 3.2),
    13: ("sphere", "radial accuracy, all effects", lambda figure, made: _radial(figure, made.sphere), 4.4),
    14: (
        "sphere-simulated",
        "radial accuracy, only gear errors",
        lambda figure, made: _radial(figure, made.sphere_gears),
        4.4,
    ),
    15: ("repeatability", "repeatability", _repeatability, 4.0),
}
"""File name, title, drawing function, and height in inches without the table, by figure number."""


def _label_axes(axes: Axes, x: str, y: str) -> None:
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.grid(color="#dddddd", lw=0.5)
    axes.spines[["top", "right"]].set_visible(False)
