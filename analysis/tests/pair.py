"""An anticlockwise and a clockwise run of one set-up against each other: what reverses with the direction.

At the same circle angle the eccentricity is the same in both, so the difference acw - cw of the angle holds
only what depends on direction and history: backlash above all (Oh 2019, figure 6 a against b). For the
distance, ISO 230-4:2005, clause 3: bidirectional circular deviation G(b) about the least-squares circle
of both paths together, and circular hysteresis H, the largest radial difference of the two.

The zeros of the gauges must not be touched between the runs. A lag between gauges and robot belongs to the
set-up: it is drawn once for both runs, from what the less certain of them knows of it, and moves them apart, which is
the worst it can do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.kinematics.arm import Array
from analysis.reporting.quantity import Quantity, figures_of
from analysis.tests.circle import CircleResult
from analysis.tests.circularity import circle_at, fit_circle
from analysis.tests.curve import DRAWS, SEED, Curve, curve_of, means, noise_sd, smoothed, stacked
from analysis.tests.lag import lag_of
from rigs.errors import FileError

_GRID = np.radians(np.arange(0.0, 360.0, 0.5))
_RANGES = ("hysteresis_max_deg", "hysteresis_max_mm", "circular_deviation_mm")


@dataclass(frozen=True)
class Pair:
    """What differs between the directions, by name; lag: of the gauges behind the robot, ms, told and not applied."""

    figures: dict[str, Quantity]
    lag: Quantity


def pair(acw: CircleResult, cw: CircleResult, where: str = "the two runs") -> Pair:
    """figures of acw - cw at the same phi: hysteresis_mean_deg with its sign, hysteresis_max_deg without and
    hysteresis_max_at_deg where; of the distance hysteresis_mean_mm, hysteresis_max_mm (H) and
    circular_deviation_mm (G(b)). Maxima are noise-corrected. Raises FileError where it is no pair."""
    _hold(acw, cw, where)
    angles = (acw.curve, cw.curve)
    distances = (_distance(acw), _distance(cw))
    radius = acw.lap.frame.radius
    u_lag_s = max(acw.u_lag_s, cw.u_lag_s)
    rng = np.random.default_rng(SEED)
    draws, calm = [], []
    for _ in range(DRAWS):
        lag_s, scale = rng.normal(0.0, u_lag_s), 1.0 + rng.normal(0.0, acw.u_scale)
        state = rng.bit_generator.state
        angle = [curve.drawn(rng, lag_s, scale) for curve in angles]
        rng.bit_generator.state = state  # the rows of a run fell where they fell, for angle and distance alike
        distance = [curve.drawn(rng, lag_s) for curve in distances]
        draws.append(plain_figures([(p, y) for p, y, _ in angle], [(p, y) for p, y, _ in distance], radius))
        calm.append(plain_figures([(p, y) for p, _, y in angle], [(p, y) for p, _, y in distance], radius))
    plain = plain_figures([(c.phi, c.y) for c in angles], [(c.phi, c.y) for c in distances], radius)
    samples = acw.samples + cw.samples
    figures = figures_of(plain, stacked(draws), samples, means(calm, _RANGES))
    lag = lag_of([(angles[0], angles[1]), (distances[0], distances[1])], [radius, 1.0], samples)
    return Pair(figures, lag)


Run = tuple[Array, Array]
"""phi (n,) rad and values (n,) there."""


def plain_figures(angle: list[Run], distance: list[Run], radius_mm: float) -> dict[str, float]:
    """The plain figures of an acw and a cw run, in this order: angle in rad, distance in mm. Differences are smoothed:
    a play shows over some degrees, and a flat curve's noise would otherwise be all that its maximum tells."""
    turned, moved = _quiet(np.degrees(difference(angle))), _quiet(difference(distance))
    phi, both = np.concatenate([run[0] for run in distance]), np.concatenate([run[1] for run in distance])
    deviation = both - circle_at(phi, fit_circle(phi, both, radius_mm), radius_mm)
    return {
        "hysteresis_mean_deg": float(turned.mean()),
        "hysteresis_max_deg": float(np.abs(turned).max()),
        "hysteresis_max_at_deg": float(np.degrees(_GRID[np.argmax(np.abs(turned))])),
        "hysteresis_mean_mm": float(moved.mean()),
        "hysteresis_max_mm": float(np.abs(moved).max()),
        "circular_deviation_mm": float(np.ptp(deviation)),
    }


def difference(runs: list[Run]) -> Array:
    """First less second run (m,) on the grid."""
    first, second = (np.interp(_GRID, *_in_order(phi, y), period=2 * np.pi) for phi, y in runs)
    between: Array = first - second
    return between


def _quiet(y: Array) -> Array:
    return smoothed(y, noise_sd(y))


def _in_order(phi: Array, y: Array) -> Run:
    turned = phi % (2 * np.pi)
    order = np.argsort(turned)
    return turned[order], y[order]


def _distance(result: CircleResult) -> Curve:
    distance = result.lap.g_mm.mean(axis=1)
    radius = result.lap.frame.radius
    return curve_of(result.lap, distance, circle_at(result.phi, fit_circle(result.phi, distance, radius), radius))


def _hold(acw: CircleResult, cw: CircleResult, where: str) -> None:
    directions = (acw.lap.direction, cw.lap.direction)
    if directions != ("acw", "cw"):
        raise FileError(
            where, f"are {directions[0]} and {directions[1]}", "give an acw run and a cw run, in this order"
        )
    one, other = acw.lap.frame, cw.lap.frame
    if abs(one.radius - other.radius) > 1e-6 or np.linalg.norm(one.centre - other.centre) > 1e-6:
        raise FileError(where, "were driven on different circles", "compare runs of one rig file")
