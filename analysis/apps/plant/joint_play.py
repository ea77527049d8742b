"""The play of each joint in a circle run: how far the readings jump where the joint turns back.

Play is all that makes the lap jump where a joint turns back; the rest of a robot's error is smooth along the lap. The
angle and the distance of a lap are therefore fitted by low orders and, for each joint that turns back, by the readings
that the model gives for a play there less those without. A wide play is crossed over many degrees, so that its shape
depends on its size: the shapes are computed for some widths, and the sizes are those of nonlinear least squares between
them. Where gravity holds the gears on one side, no jump shows and the figure is near zero. Source: Y. T. Oh, Applied
Sciences 9 (2019), 3.2.

Near a reversal, a wave of a gear can look like a play. A gear is out by a wave of the joint's angle, and a joint that
turns back runs through the same wave twice, so that the lap has no jump there but a bend. Fitted by plays alone, a gear
of axis 4 with order 8 was a play of axis 5 of -0.30° ± 0.03°. So waves of all axes and of the usual orders are fitted
with the plays, each with a size of its own that the lap determines (automatic relevance, MacKay 1992): what the lap
does not show costs nothing, what it cannot distinguish from a play is in the play's uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from analysis.procedures.circle.evaluate import CircleResult
from analysis.procedures.circle.joint_reversals import turns
from analysis.procedures.prediction import nominal_setup, path_of, predict
from analysis.procedures.results import Result
from analysis.procedures.shared.quantity import Quantity
from analysis.procedures.shared.reduction import PHI
from analysis.robot.geometry.circle import link_angle
from analysis.robot.kinematics.arm import Array, Mask
from analysis.robot.model.predict import model_of
from analysis.runs.laps import Laps
from analysis.runs.tables import CircleTable
from rigs.effects import Effect, play_of_joint
from rigs.rig import Rig

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline


ORDERS = (1, 2, 3, 4, 5, 6, 8, 10, 12)
"""Cycles a turn of a joint: eccentric wheels, wave generators and their stages; what is faster is seldom as large, and
shorter than the neighbourhood that a jump is judged by."""
_SIZE_DEG = 0.005
"""What a wave is taken to have at the beginning: usual gears have some thousandths of a degree."""
_LEAST_DEG = 1e-6
_ROUNDS = 40


@dataclass(frozen=True)
class Fitted:
    """sizes (p,) of the plays in degrees, their part of the solution (p, m) by the readings (m,), the variance of a
    reading, and the misfit: minus twice the log of the evidence, of which the least is the best."""

    sizes_deg: Array
    solve: Array
    u_deg: Array
    misfit: float


def waves_of(slopes: Array, q: Array) -> Array:
    """What waves of one degree make of a lap: (m, 2 pairs) in mm, a sine and a cosine beside one another.

    slopes (m, 6) mm for each degree by which a joint is out; q (m, 6) rad, the joints at the same readings.
    """
    turns = q[:, :, None] * np.array(ORDERS)
    both = np.stack([np.sin(turns), np.cos(turns)], axis=3) * slopes[:, :, None, None]
    waves: Array = both.reshape(len(q), -1)
    return waves


def fitted(
    lap: Array,
    curve: Callable[[Array], Array],
    slopes: Callable[[Array], Array],
    waves: Array,
    start_deg: Array,
    widest_deg: float,
    alike: float,
) -> Fitted:
    """Plays and waves that fit a lap (m,) mm, from plays of start_deg (p,).

    curve, slopes: what plays (p,) in degrees make of the lap, (m,) mm, and its derivatives (m, p); waves (m, k) mm for
    each degree; alike: of how many readings one is by itself.
    """
    sizes, plays = start_deg.copy(), len(start_deg)
    variances = np.full(waves.shape[1] // 2, _SIZE_DEG**2)
    noise = max(float(lap.var()), 1e-18) * alike
    squares = waves.T @ waves
    for _ in range(_ROUNDS):
        by_play = slopes(sizes)
        target = lap - curve(sizes) + by_play @ sizes
        cross = by_play.T @ waves
        information = np.block([[by_play.T @ by_play, cross], [cross.T, squares]]) / noise
        prior = np.concatenate([np.full(plays, 1e-9), 1 / np.repeat(variances, 2)])
        covariance = np.linalg.inv(information + np.diag(prior))
        columns = np.concatenate([by_play, waves], axis=1)
        solution = covariance @ (columns.T @ target) / noise
        step = np.clip(solution[:plays] - sizes, -0.05, 0.05)
        sizes = np.clip(sizes + step, -widest_deg, widest_deg)
        residuals_mm = lap - curve(sizes) - waves @ solution[plays:]
        of_waves = solution[plays:] ** 2 + np.diag(covariance)[plays:]
        determined = len(solution) - float(prior @ np.diag(covariance))
        noise = max(float(residuals_mm @ residuals_mm) * alike / max(len(lap) / alike - determined, 1.0) / alike, 1e-18)
        variances = np.maximum(of_waves.reshape(-1, 2).mean(axis=1), _LEAST_DEG**2)
    solve = (covariance @ columns.T / noise)[:plays]
    penalty = float((solution[plays:] ** 2 / np.repeat(variances, 2)).sum() + np.log(np.repeat(variances, 2)).sum())
    evidence = len(lap) / alike * np.log(noise) + float(residuals_mm @ residuals_mm) / noise + penalty
    misfit = float(evidence - np.linalg.slogdet(covariance)[1])
    return Fitted(sizes, solve, np.sqrt(np.diag(covariance)[:plays]), misfit)


_SMOOTH = 12
"""Orders that count as smooth: offsets, links and set-up make orders up to 3, eccentric gears some more."""
_WIDTHS_DEG = np.concatenate([0.0025 * 2 ** np.arange(0.0, 6.1, 0.25), [0.32]])
"""Plays that the readings are computed for; between them they go smoothly. Steps of a factor of 1.19: with 1.41 the
curve of a play of 0.024° was wrong by half the noise of a reading, and a play of another joint took what was left."""
_BOTH_WAYS_DEG = np.concatenate([-_WIDTHS_DEG[::-1], [0.0], _WIDTHS_DEG])
_ROWS = 3000
"""Rows of a lap that the model is computed for: four a node."""
_INDEPENDENT = 72
"""Pieces of a lap that err independently: a jump is judged by a neighbourhood of some 5°."""
_OUT_DEG = 0.01
"""So little that the readings follow it in proportion."""
_BELOW_ZERO = 3.0
"""No play is below zero. What noise puts there is a play of zero; further off, it is something else than a play."""
_WORST_U_DEG = 0.05
"""A play known no better than this is left out: its jumps are too small, or too close to those of another joint."""


@dataclass(frozen=True)
class _Jumps:
    """What plays make of a lap, smoothly in their widths: of each axis curves (2 widths + 1, 2 NODES) mm, from the
    widest negative play, a mirror image that noise may look like, over none to the widest."""

    curves: Array
    by_width: tuple[CubicSpline, ...]

    @classmethod
    def through(cls, wider: Array) -> _Jumps:
        """The jumps through the curves (axes, widths, 2 NODES) mm of plays of _WIDTHS_DEG."""
        from scipy.interpolate import CubicSpline  # noqa: PLC0415 - slow to import, needed where a run is read only

        curves = np.concatenate([-wider[:, ::-1], np.zeros_like(wider[:, :1]), wider], axis=1)
        return cls(curves, tuple(CubicSpline(_BOTH_WAYS_DEG, curve) for curve in curves))

    def of(self, sizes_deg: Array) -> Array:
        """The curve (2 NODES,) mm of plays (axes,) in degrees."""
        curves = [spline(size) for spline, size in zip(self.by_width, sizes_deg, strict=True)]
        together: Array = np.sum(curves, axis=0)
        return together

    def slopes(self, sizes_deg: Array) -> Array:
        """Its derivatives (2 NODES, axes) in mm for each degree."""
        return np.stack([spline(size, 1) for spline, size in zip(self.by_width, sizes_deg, strict=True)], axis=1)


def joint_plays(result: Result) -> dict[str, Quantity]:
    """`play_j1_deg` … of the joints that turn back, of a yaw or roll run; nothing for other tests.

    u holds the noise within the run and what the fit leaves unexplained.
    """
    circle, table = result.found, result.measured.table
    if not isinstance(circle, CircleResult) or not isinstance(table, CircleTable):
        return {}
    axes = sorted({turn.axis for turn in turns(circle.laps)})
    if not axes:
        return {}
    half_mm = result.measured.rig.gauges.baseline_mm / 2
    basis = np.linalg.qr(_smooth())[0]

    def rough(curves: Array) -> Array:
        """Curves (..., 2 NODES) mm without what is smooth in them."""
        rest_mm: Array = curves - (curves @ basis) @ basis.T
        return rest_mm

    modelled = _Lap.of(circle.laps, table, result.measured.rig, half_mm)
    wider = rough(np.array([[modelled.play(axis, width) for width in _WIDTHS_DEG.tolist()] for axis in axes]))
    jumps = _Jumps.through(wider)
    lap = rough(np.concatenate([circle.curve.y * half_mm, circle.distance.curve.y]))
    errors = rough(np.concatenate([circle.curve.errors * half_mm, circle.distance.curve.errors], axis=1))
    slopes = np.stack([modelled.offset(axis) for axis in range(1, 7)], axis=1)
    waves = waves_of(slopes, np.tile(modelled.q, (2, 1)))
    waves -= basis @ (basis.T @ waves)
    best = min(
        (
            fitted(lap, jumps.of, jumps.slopes, waves, start, float(_WIDTHS_DEG[-1]), len(PHI) / _INDEPENDENT)
            for start in _starts(lap, jumps)
        ),
        key=lambda fit: fit.misfit,
    )
    u = np.hypot((errors @ best.solve.T).std(axis=0), best.u_deg)
    return {
        f"play_j{axis}_deg": Quantity(max(size, 0.0), float(u[k]), "deg", circle.samples, circle.curve.noise.source)
        for k, (axis, size) in enumerate(zip(axes, best.sizes_deg.tolist(), strict=True))
        if u[k] < _WORST_U_DEG and size > -_BELOW_ZERO * u[k]
    }


def _starts(lap: Array, jumps: _Jumps) -> tuple[Array, Array]:
    """Sizes (axes,) in degrees to begin with, of a lap (2 NODES,) mm: no play, and the widths that explain most of it
    one after the other, since plays of joints that turn back together look alike."""
    none = np.zeros(len(jumps.curves))
    start, residual_mm = none.copy(), lap
    for _ in start:
        gaps = np.where(start[:, None] == 0, ((residual_mm - jumps.curves) ** 2).sum(axis=2), np.inf)
        axis, width = np.unravel_index(np.argmin(gaps), gaps.shape)
        if gaps[axis, width] >= residual_mm @ residual_mm:
            break
        start[axis] = 0.99 * _BOTH_WAYS_DEG[width]
        residual_mm = lap - jumps.of(start)
    return none, start


@dataclass(frozen=True)
class _Lap:
    """The first lap, as the model has it. q (NODES, 6) rad: the joints at the nodes."""

    rig: Rig
    way: CircleTable
    inside: Mask
    phi: Array
    half_mm: float
    q: Array
    without: Array

    @classmethod
    def of(cls, laps: Laps, table: CircleTable, rig: Rig, half_mm: float) -> _Lap:
        lap = laps.first
        # With the lead-in, since a play is where the joint came from; to the end of the first lap.
        upto = int(np.searchsorted(table.t_s, lap.t_s[-1], side="right"))
        rows = slice(None, upto, max(1, len(lap.t_s) // _ROWS))
        way = replace(table, t_s=table.t_s[rows], q=table.q[rows], g_mm=table.g_mm[rows], u_t_s=None)
        inside = way.t_s >= lap.t_s[0]
        phi = np.interp(way.t_s[inside], lap.t_s, lap.phi)
        q = np.stack([np.interp(PHI, phi, joint, period=2 * np.pi) for joint in way.q[inside].T], axis=1)
        bare = cls(rig, way, inside, phi, half_mm, q, np.zeros(2 * len(PHI)))
        return replace(bare, without=bare.nodes(()))

    def nodes(self, effects: tuple[Effect, ...], out: Array | None = None) -> Array:
        """Angle and distance (2 NODES,) mm of a robot with effects, its joints out by `out` (6,) rad."""
        model = model_of(self.rig, effects)
        way = self.way if out is None else replace(self.way, q=self.way.q + out)
        g_mm = predict(model, way, path_of(model, way), nominal_setup(self.rig, self.way))[self.inside]
        turned = link_angle(g_mm[:, 0], g_mm[:, 1], 2 * self.half_mm) * self.half_mm
        return np.concatenate([np.interp(PHI, self.phi, y, period=2 * np.pi) for y in (turned, g_mm.mean(axis=1))])

    def play(self, axis: int, width_deg: float) -> Array:
        """What a play of an axis, in degrees, makes of angle and distance (2 NODES,) mm."""
        return self.nodes((play_of_joint(axis, width_deg),)) - self.without

    def offset(self, axis: int) -> Array:
        """What an axis that is out makes of angle and distance, (2 NODES,) mm for each degree."""
        out = np.where(np.arange(1, 7) == axis, np.radians(_OUT_DEG), 0.0)
        return (self.nodes((), out) - self.without) / _OUT_DEG


def _smooth() -> Array:
    """Low orders (2 NODES, orders), of length 1, of angle and distance, each its own."""
    orders = np.arange(1, _SMOOTH + 1) * PHI[:, None]
    block = np.concatenate([np.ones((len(PHI), 1)), np.cos(orders), np.sin(orders)], axis=1)
    none = np.zeros_like(block)
    return np.block([[block, none], [none, block]])
