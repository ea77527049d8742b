"""Compare an anticlockwise and a clockwise run of one set-up: the part that depends on direction.

At a circle angle the eccentricity is the same in both, so the difference acw - cw of the angle only contains effects
of direction and history: mainly backlash (Oh 2019, figure 6 a and b). For the distance, ISO 230-4:2005, clause 3:
bidirectional circular deviation G(b) about the least-squares circle of both paths, and circular hysteresis H, the
largest radial difference.

Ball and gauge zeros must not be touched between the runs. A moved ball causes a difference of order one only, in the
distance and, for yaw, equally in the angle: such runs are not a pair. A lag between gauges and robot belongs to the
set-up: it is drawn once for both runs, with the larger uncertainty of the two, and shifts them in opposite directions,
the worst case.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.procedures.circle import DISTANCE_RANGES, CircleResult, circle_at, fit_circle
from analysis.procedures.shared.lap_curve import (
    PHI,
    RANGE_U,
    SEED,
    LapCurve,
    at_resolution,
    blurred,
    calmed,
    figures,
)
from analysis.procedures.shared.quantity import PLACE, Quantity, figures_of, from_draws
from analysis.robot.kinematics.arm import Array
from analysis.runs.noise.cell_noise import BALL_ELSEWHERE_MM, BALL_MM, JOINT_DEG
from analysis.runs.noise.spectrum import DRAWS, NODES
from rigs.errors import FileError

_SURE = 0.9545
"""Share of the draws covered by 2 u."""
_PLATEAU_ROUNDS = 2
"""Number of rounds for finding a plateau of the curve.

The wider a plateau is, the further noise may move its points below the maximum.
"""
_HALVINGS = 10
"""Number of bisections for the clipping level, which gives a thousandth of the noise contribution."""


def largest(curve: Array, errors: Array, blur: float, unit: str, samples: int) -> tuple[Quantity, Quantity]:
    """Largest absolute value of a curve (NODES,), in its unit, and its position.

    errors (m, NODES): possible noise. blur: standard deviation, rad, of the positions of its rows, which lowers narrow
    peaks.

    The maximum of a noisy curve is biased upwards, depending on the number of points close to it. On a plateau, such as
    between two reversals with backlash, any point may be the largest. So the curve is clipped at the level for which
    the observed maximum is the median after adding the noise again. This is the least favourable curve consistent with
    the readings, as in the half-median-unbiased bounds of Chernozhukov, Lee and Rosen (Intersection bounds,
    Econometrica 2013).
    """
    peak = int(np.argmax(np.abs(curve)))
    top = float(np.abs(curve[peak]))
    # Clipping level for which the observed maximum is the median after adding the errors again.
    upright, upright_errors = curve * np.sign(curve[peak]), errors * np.sign(curve[peak])
    low, high = max(top - float(np.median(upright_errors.max(axis=1))), 0.0), top
    for _ in range(_HALVINGS):
        level = (low + high) / 2
        if float(np.median((np.minimum(upright, level) + upright_errors).max(axis=1))) > top:
            high = level
        else:
            low = level
    level = (low + high) / 2
    flat = np.clip(curve, -level, level)
    lost = max(level - float(np.abs(blurred(flat, blur)).max()), 0.0)
    again = np.abs(flat + errors)
    u = float(np.sqrt(from_draws(0.0, again.max(axis=1), unit).u ** 2 + (RANGE_U * (top - level)) ** 2 + lost**2))
    # Candidate nodes are no further below the maximum than a plateau point may be.
    for _ in range(_PLATEAU_ROUNDS):
        below = float(np.quantile(again.max(axis=1) - again[:, peak], _SURE))
        flat = np.where(np.abs(curve) >= top - below, np.abs(flat[peak]) * np.sign(curve), flat)
        again = np.abs(flat + errors)
    at = np.degrees(PHI)
    place = figures_of({PLACE: float(at[peak])}, {PLACE: at[again.argmax(axis=1)]}, samples)[PLACE]
    return Quantity(level + lost, u, unit, samples), place


Complex = NDArray[np.complex128]
_HARMONICS = np.arange(1, 9)
_LAG_ROUNDS = 10
_MOVED_MM = float(np.hypot(BALL_MM.middle, 1000.0 * np.radians(JOINT_DEG.middle)))
"""Motion of a circle between runs: its ball, and a joint at the end of a one-metre arm."""


def lag_of(pairs: Sequence[tuple[LapCurve, LapCurve]], radii_mm: Sequence[float], samples: int) -> Quantity:
    """Delay in ms by which the gauges lag the robot's feedback, from acw and cw curves on one circle.

    Several kinds (angle, distance) together determine it better. radii_mm: per kind, the conversion of ball motion to
    its unit: 1 for a distance, the circle's radius for an angle.

    Late stamps shift the curve along the motion, forwards in one direction and backwards in the other, so acw - cw
    contains twice the lag times the speed times the slope of the curve. Backlash and friction also depend on the
    direction, and their first harmonic is indistinguishable from a lag. Their other harmonics indicate its possible
    size: it is modelled as random, decreasing with the order as for a step, and determines the uncertainty, together
    with the repeatability of the robot. A single direction shows nothing: there a lag looks like a displaced ball.
    """
    kinds = []  # harmonics (h,) of acw - cw and of the response to a lag of 1 s, and variance of each without backlash
    for (acw, cw), radius_mm in zip(pairs, radii_mm, strict=True):
        forth, back = _harmonics(acw.y), _harmonics(cw.y)
        speed, moved = abs(acw.rate) + abs(cw.rate), _MOVED_MM / radius_mm
        drawn = sum(np.mean(np.abs(_harmonics(curve.errors)) ** 2, axis=0) / 2 for curve in (acw, cw))
        of_lag = -speed * 1j * _HARMONICS * (forth + back) / 2
        kinds.append((forth - back, of_lag, (moved / _HARMONICS) ** 2 + drawn))
    spreads = [0.0] * len(kinds)
    value_s = u_s = 0.0
    for _ in range(_LAG_ROUNDS):
        information = pull = 0.0
        for (between, of_lag, noise), spread in zip(kinds, spreads, strict=True):
            weight = 1 / (spread / _HARMONICS**2 + noise)
            information += float(weight @ np.abs(of_lag) ** 2)
            pull += float(weight @ (of_lag.conj() * between).real)
        if not information > 0:
            return Quantity(0.0, float("inf"), "ms", samples)
        value_s, u_s = pull / information, information**-0.5
        # Variance of the first harmonic of direction-dependent effects other than lag.
        beyond = [np.abs(between - value_s * of_lag) ** 2 / 2 - noise for between, of_lag, noise in kinds]
        spreads = [float((np.maximum(power, 0.0) * _HARMONICS**2).mean()) for power in beyond]
    return Quantity(1e3 * value_s, 1e3 * u_s, "ms", samples)


def _harmonics(y: Array) -> Complex:
    both: Complex = 2 * np.fft.rfft(y)[..., _HARMONICS] / NODES
    return both


_ALIKE = 0.5
"""Permitted relative difference between ball motions from angle and distance; the latter also contains backlash."""
_ALONE, _MOSTLY = 0.9, 0.5
"""Share of the energy of acw - cw explained by a moved ball; backlash, changing sign at each reversal, has more energy
in higher orders."""


@dataclass(frozen=True)
class DirectionPair:
    """Differences between the directions by name; lag: delay of the gauges behind the robot in ms, not corrected."""

    figures: dict[str, Quantity]
    lag: Quantity


def pair(acw: CircleResult, cw: CircleResult, where: str = "the two runs") -> DirectionPair:
    """Figures of acw - cw at the same phi.

    hysteresis_mean_deg (signed), hysteresis_max_deg (absolute) and its position hysteresis_max_at_deg; for the distance
    hysteresis_mean_mm, hysteresis_max_mm (H) and circular_deviation_mm (G(b)). Maxima are noise-corrected. Raises
    FileError if the runs are not a pair.
    """
    _require_pair(acw, cw, where)
    curves = [acw.curve, cw.curve, acw.distance.curve, cw.distance.curve]
    radius = acw.laps.frame.radius
    rng = np.random.default_rng(SEED)
    lag_s = rng.normal(0.0, max(acw.u_lag_s, cw.u_lag_s), DRAWS)
    turned = [run.curve.turned(lag_s) for run in (acw, cw)] * 2
    scale, unscaled = 1.0 + rng.normal(0.0, acw.u_scale, DRAWS), np.ones(DRAWS)

    def draw_noise(about: Sequence[Array]) -> list[Array]:
        parts = zip(curves, about, turned, (scale, scale, unscaled, unscaled), strict=True)
        return [curve.draw_noise(y, orders, factor) for curve, y, orders, factor in parts]

    samples = acw.samples + cw.samples
    calm = [*_calm(acw.curve, cw.curve), *_calm(acw.distance.curve, cw.distance.curve)]
    of_pair = figures(lambda y: figures_at(y, radius), curves, draw_noise, samples, DISTANCE_RANGES, calm)
    # Largest hysteresis of angle and distance, and its position for the angle.
    draws, noise = draw_noise([curve.y for curve in curves]), of_pair["hysteresis_mean_deg"].noise
    sizes = []
    for k, unit, per_unit in ((0, "deg", np.degrees(1.0)), (2, "mm", 1.0)):
        between = per_unit * at_resolution(curves[k].y - curves[k + 1].y)
        errors = per_unit * at_resolution(draws[k] - draws[k + 1]) - between
        blur = float(np.hypot(curves[k].blur, curves[k + 1].blur) / np.sqrt(2))
        sizes += [replace(figure, noise=noise) for figure in largest(between, errors, blur, unit, samples)]
    of_pair |= zip(("hysteresis_max_deg", "hysteresis_max_at_deg", "hysteresis_max_mm"), sizes, strict=False)
    for unit in ("deg", "mm"):
        largest_name, mean = f"hysteresis_max_{unit}", abs(of_pair[f"hysteresis_mean_{unit}"].value)
        # The noise correction can be too large; the maximum is never below the mean.
        of_pair[largest_name] = replace(of_pair[largest_name], value=max(of_pair[largest_name].value, mean))
    lag = lag_of([(curves[0], curves[1]), (curves[2], curves[3])], [radius, 1.0], samples)
    return DirectionPair(of_pair, lag)


def _calm(acw: LapCurve, cw: LapCurve) -> tuple[Array, Array]:
    power = acw.power + cw.power
    mean, half = calmed((acw.y + cw.y) / 2, power / 4), calmed((acw.y - cw.y) / 2, power / 4)
    return mean + half, mean - half


def figures_at(y: Array, radius_mm: float) -> dict[str, Array]:
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
    """Motion of the ball between the runs, mm; 0 if the robot may explain the difference.

    Backlash also changes the first order of the distance; for yaw the angle shows the ball independently, and backlash
    hardly gives the same value there.
    """
    moved = acw.distance.ball_mm - cw.distance.ball_mm
    by_angle = acw.laps.frame.radius * np.array([-(acw.sine.a - cw.sine.a), acw.sine.b - cw.sine.b])
    size, seen = float(np.linalg.norm(moved)), float(np.linalg.norm(by_angle))
    power = np.abs(np.fft.rfft(acw.distance.curve.y - cw.distance.curve.y) / NODES)[1:] ** 2
    first_share = float(power[0] / max(power.sum(), 1e-30))
    if seen > BALL_ELSEWHERE_MM and float(np.linalg.norm(by_angle - moved)) < _ALIKE * seen and first_share > _MOSTLY:
        return seen
    # In roll the ball position does not affect the sine of the angle.
    return size if size > BALL_ELSEWHERE_MM and first_share > _ALONE and seen < 0.1 * size else 0.0


def _require_pair(acw: CircleResult, cw: CircleResult, where: str) -> None:
    directions = (acw.laps.direction, cw.laps.direction)
    if directions != ("acw", "cw"):
        problem = f"are {directions[0]} and {directions[1]}"
        raise FileError(where, problem, "give an acw run and a cw run, in this order", code="readings.unsuitable")
    circle, second = acw.laps.frame, cw.laps.frame
    if abs(circle.radius - second.radius) > 1e-6 or np.linalg.norm(circle.centre - second.centre) > 1e-6:
        raise FileError(
            where, "were driven on different circles", "compare runs of one rig file", code="readings.unsuitable"
        )
    if moved_mm := ball_moved_mm(acw, cw):
        fact = f"have their balls {moved_mm:.2f} mm apart: the ball or a gauge was moved in between"
        remedy = "record acw and cw without touching the ball or the gauges in between"
        raise FileError(
            where, f"{fact}, so that acw - cw does not show the hysteresis", remedy, code="readings.unsuitable"
        )
