"""An anticlockwise and a clockwise run of one set-up against each other: what reverses with the direction.

At the same circle angle the eccentricity is the same in both, so the difference acw - cw of the angle holds
only what depends on direction and history: backlash above all (Oh 2019, figure 6 a against b). For the
distance, ISO 230-4:2005, clause 3: bidirectional circular deviation G(b) about the least-squares circle
of both paths together, and circular hysteresis H, the largest radial difference of the two.

Ball and zeros of the gauges must not be touched between the runs. A ball that sits elsewhere makes a difference of
order one and nothing else, in the distance and, of a yaw, in the angle alike: such runs are not a pair. A lag between
gauges and robot belongs to the set-up: it is drawn once for both runs, from what the less certain of them knows of it,
and moves them apart, which is the worst it can do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.kinematics.arm import Array
from analysis.measures.circularity import circle_at, fit_circle
from analysis.measures.lag import lag_of
from analysis.measures.lap_curve import SEED, LapCurve, at_resolution, calmed, figures
from analysis.measures.largest import largest
from analysis.measures.link_angle import CircleResult
from analysis.measures.quantity import Quantity
from analysis.measures.reduction import PHI, nodes_of
from analysis.noise.cell import BALL_ELSEWHERE_MM
from analysis.noise.spectrum import DRAWS, NODES
from rigs.errors import FileError

RANGES = frozenset({"circular_deviation_mm"})
_ALIKE = 0.5
"""The share of a move by the angle by which the move by the distance, which a play changes too, may differ."""
_ALONE, _MOSTLY = 0.9, 0.5
"""Share of acw - cw, as energy, that a ball elsewhere explains; a play, which changes its side at each reversal of a
joint, leaves much of itself in the higher orders."""


@dataclass(frozen=True)
class DirectionPair:
    """What differs between the directions, by name; lag: of the gauges behind the robot, ms, reported and not
    applied."""

    figures: dict[str, Quantity]
    lag: Quantity


def pair(acw: CircleResult, cw: CircleResult, where: str = "the two runs") -> DirectionPair:
    """figures of acw - cw at the same phi: hysteresis_mean_deg with its sign, hysteresis_max_deg without and
    hysteresis_max_at_deg where; of the distance hysteresis_mean_mm, hysteresis_max_mm (H) and
    circular_deviation_mm (G(b)). Maxima are noise-corrected. Raises FileError where they are not a pair."""
    _hold(acw, cw, where)
    curves = [acw.curve, cw.curve, acw.distance.curve, cw.distance.curve]
    radius = acw.laps.frame.radius
    rng = np.random.default_rng(SEED)
    lag_s = rng.normal(0.0, max(acw.u_lag_s, cw.u_lag_s), DRAWS)
    turned = [run.curve.turned(lag_s) for run in (acw, cw)] * 2
    scale, unscaled = 1.0 + rng.normal(0.0, acw.u_scale, DRAWS), np.ones(DRAWS)

    def drawn(about: Sequence[Array]) -> list[Array]:
        parts = zip(curves, about, turned, (scale, scale, unscaled, unscaled), strict=True)
        return [curve.drawn(y, orders, factor) for curve, y, orders, factor in parts]

    samples = acw.samples + cw.samples
    calm = [*_calm(acw.curve, cw.curve), *_calm(acw.distance.curve, cw.distance.curve)]
    of_pair = figures(lambda y: figures_at(y, radius), curves, drawn, samples, RANGES, calm)
    # The largest hysteresis of angle and distance, and the place of that of the angle.
    draws, noise = drawn([curve.y for curve in curves]), of_pair["hysteresis_mean_deg"].noise
    sizes = []
    for k, unit, per_unit in ((0, "deg", np.degrees(1.0)), (2, "mm", 1.0)):
        between = per_unit * at_resolution(curves[k].y - curves[k + 1].y)
        errors = per_unit * at_resolution(draws[k] - draws[k + 1]) - between
        blur = float(np.hypot(curves[k].blur, curves[k + 1].blur) / np.sqrt(2))
        sizes += [replace(figure, noise=noise) for figure in largest(between, errors, blur, unit, samples)]
    of_pair |= zip(("hysteresis_max_deg", "hysteresis_max_at_deg", "hysteresis_max_mm"), sizes, strict=False)
    for unit in ("deg", "mm"):
        largest_name, mean = f"hysteresis_max_{unit}", abs(of_pair[f"hysteresis_mean_{unit}"].value)
        # What is taken off for the noise may be more than there is; no largest value is below the mean.
        of_pair[largest_name] = replace(of_pair[largest_name], value=max(of_pair[largest_name].value, mean))
    lag = lag_of([(curves[0], curves[1]), (curves[2], curves[3])], [radius, 1.0], samples)
    return DirectionPair(of_pair, lag)


def _calm(acw: LapCurve, cw: LapCurve) -> tuple[Array, Array]:
    """Both curves (NODES,) with the noise reduced of their mean and of their difference, which is small beside them."""
    power = acw.power + cw.power
    mean, half = calmed((acw.y + cw.y) / 2, power / 4), calmed((acw.y - cw.y) / 2, power / 4)
    return mean + half, mean - half


Run = tuple[Array, Array]
"""phi (n,) rad and values (n,) there."""


def plain_figures(angle: list[Run], distance: list[Run], radius_mm: float) -> dict[str, float]:
    """The plain figures of a noise-free acw and cw run, in this order: angle in rad, distance in mm."""
    nodes = np.stack([nodes_of(phi, y) for phi, y in (*angle, *distance)])
    return {name: float(value) for name, value in figures_at(nodes, radius_mm).items()}


def figures_at(y: Array, radius_mm: float) -> dict[str, Array]:
    """The plain figures (...,) of curves (4, ..., NODES): angle acw and cw, distance acw and cw."""
    turned, moved = at_resolution(np.degrees(y[0] - y[1])), at_resolution(y[2] - y[3])
    fit = (fit_circle(y[2], radius_mm) + fit_circle(y[3], radius_mm)) / 2
    deviation = at_resolution(y[2:] - circle_at(fit, radius_mm))
    return {
        "hysteresis_mean_deg": turned.mean(axis=-1),
        "hysteresis_max_deg": np.abs(turned).max(axis=-1),
        "hysteresis_max_at_deg": np.degrees(PHI)[np.argmax(np.abs(turned), axis=-1)],
        "hysteresis_mean_mm": moved.mean(axis=-1),
        "hysteresis_max_mm": np.abs(moved).max(axis=-1),
        "circular_deviation_mm": deviation.max(axis=(0, -1)) - deviation.min(axis=(0, -1)),
    }


def ball_moved_mm(acw: CircleResult, cw: CircleResult) -> float:
    """How far the ball moved between the runs, mm; 0 where the robot may explain the difference.

    A play moves the distance by the way that a joint turns, and with it the first order too; of a yaw the angle shows
    the ball a second time, and a play hardly shows the same there.
    """
    moved = acw.distance.ball_mm - cw.distance.ball_mm
    by_angle = acw.laps.frame.radius * np.array([-(acw.sine.a - cw.sine.a), acw.sine.b - cw.sine.b])
    size, seen = float(np.linalg.norm(moved)), float(np.linalg.norm(by_angle))
    power = np.abs(np.fft.rfft(acw.distance.curve.y - cw.distance.curve.y) / NODES)[1:] ** 2
    first_share = float(power[0] / max(power.sum(), 1e-30))
    if seen > BALL_ELSEWHERE_MM and float(np.linalg.norm(by_angle - moved)) < _ALIKE * seen and first_share > _MOSTLY:
        return seen
    # In roll the ball's place does not show in the angle's sine.
    return size if size > BALL_ELSEWHERE_MM and first_share > _ALONE and seen < 0.1 * size else 0.0


def _hold(acw: CircleResult, cw: CircleResult, where: str) -> None:
    directions = (acw.laps.direction, cw.laps.direction)
    if directions != ("acw", "cw"):
        problem = f"are {directions[0]} and {directions[1]}"
        raise FileError(where, problem, "give an acw run and a cw run, in this order")
    circle, second = acw.laps.frame, cw.laps.frame
    if abs(circle.radius - second.radius) > 1e-6 or np.linalg.norm(circle.centre - second.centre) > 1e-6:
        raise FileError(where, "were driven on different circles", "compare runs of one rig file")
    if moved_mm := ball_moved_mm(acw, cw):
        fact = f"have their balls {moved_mm:.2f} mm apart: the ball or a gauge was moved between them"
        remedy = "record acw and cw without touching the ball or the gauges in between"
        raise FileError(where, f"{fact}, so that acw - cw does not show the hysteresis", remedy)
