"""Backlash of each joint in a circle run: the jump at joint reversals (Y. T. Oh, Applied Sciences 9 (2019), 3.2).

Angle and distance of a lap are fitted by low orders and by the modelled response to the backlash of each reversing
joint, computed for several widths. If gravity keeps the gears on one flank, the figure is near zero.

A gear wave gives a bend instead of a jump. Waves of usual orders are therefore fitted too, with sizes determined by the
lap (automatic relevance, MacKay 1992); those that resemble backlash increase u.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from analysis.procedures.circle import CircleResult
from analysis.procedures.results import Result
from analysis.procedures.shared.joint_reversals import turns
from analysis.procedures.shared.lap_curve import PHI
from analysis.procedures.shared.quantity import Quantity
from analysis.procedures.shared.test_kind import nominal_setup, path_of, predict
from analysis.robot.geometry.circle import link_angle
from analysis.robot.kinematics.arm import Array, Mask, arm_of, drive_angles
from analysis.robot.predict import model_of
from analysis.runs.laps import Laps
from analysis.runs.tables import CircleTable
from rigs.effects import Effect, play_of_joint, turned
from rigs.rig import Rig

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline


ORDERS = (1, 2, 3, 4, 5, 6, 8, 10, 12)
"""Waves per turn of a joint: eccentricity, wave generators and their stages. Faster waves are rarely as large."""
_SIZE_DEG = 0.005
_LEAST_DEG = 1e-6
_ROUNDS = 40


@dataclass(frozen=True)
class Fitted:
    """Backlash (p,) with u (p,), its dependence on the readings (p, m), and minus twice the log evidence."""

    sizes_deg: Array
    solve: Array
    u_deg: Array
    misfit: float


def waves_of(slopes: Array, q: Array) -> Array:
    """Response (m, 2 pairs) of a lap to waves of one degree, sine and cosine.

    slopes (m, 6): in mm per degree. q (m, 6): rad.
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
    """Fit backlash and waves to a lap (m,) mm.

    curve, slopes: response (m,) mm to backlash (p,) in degrees, and derivatives (m, p). waves (m, k): mm per degree.
    alike: number of correlated readings.
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
"""Offsets, links and set-up have orders up to 3, eccentric gears some more."""
_WIDTHS_DEG = np.concatenate([0.0025 * 2 ** np.arange(0.0, 6.1, 0.25), [0.32]])
"""Widths with computed responses, a factor of 1.19 apart. With 1.41 the curve of 0.024° was wrong by half the noise of
a reading.
"""
_BOTH_WAYS_DEG = np.concatenate([-_WIDTHS_DEG[::-1], [0.0], _WIDTHS_DEG])
_ROWS = 3000
_INDEPENDENT = 72
"""A jump is judged by a neighbourhood of about 5°."""
_OUT_DEG = 0.01
_BELOW_ZERO = 3.0
"""Multiple of u: backlash is never negative, so the cause is a different one beyond it."""
_WORST_U_DEG = 0.05
"""Jumps too small, or too close to those of another joint."""


@dataclass(frozen=True)
class _Jumps:
    """Response to backlash, smooth in the width.

    curves (axes, 2 widths + 1, 2 NODES) mm: from the widest negative width, which noise may resemble, to the widest.
    """

    curves: Array
    by_width: tuple[CubicSpline, ...]

    @classmethod
    def through(cls, wider: Array) -> _Jumps:
        from scipy.interpolate import CubicSpline  # noqa: PLC0415 - slow to import, needed where a run is read only

        curves = np.concatenate([-wider[:, ::-1], np.zeros_like(wider[:, :1]), wider], axis=1)
        return cls(curves, tuple(CubicSpline(_BOTH_WAYS_DEG, curve) for curve in curves))

    def of(self, sizes_deg: Array) -> Array:
        curves = [spline(size) for spline, size in zip(self.by_width, sizes_deg, strict=True)]
        together: Array = np.sum(curves, axis=0)
        return together

    def slopes(self, sizes_deg: Array) -> Array:
        return np.stack([spline(size, 1) for spline, size in zip(self.by_width, sizes_deg, strict=True)], axis=1)


def joint_plays(result: Result) -> dict[str, Quantity]:
    """`play_j1_deg` … of the reversing joints in a circle run. u includes the unexplained part of the fit."""
    circle, table = result.found, result.measured.table
    if not isinstance(circle, CircleResult) or not isinstance(table, CircleTable):
        return {}
    drives = replace(circle.laps, q=drive_angles(arm_of(result.measured.rig.robot), circle.laps.q))
    axes = sorted({turn.axis for turn in turns(drives)})
    if not axes:
        return {}
    half_mm = result.measured.rig.gauges.baseline_mm / 2
    basis = np.linalg.qr(_smooth())[0]

    def rough(curves: Array) -> Array:
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
    """Zero, and the widths that explain most of a lap in turn, because joints that reverse together look alike."""
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
    """The first lap as modelled. q (NODES, 6): of the drives in rad."""

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
        # Include the lead-in, because backlash depends on the history, and end with the first lap.
        upto = int(np.searchsorted(table.t_s, lap.t_s[-1], side="right"))
        rows = slice(None, upto, max(1, len(lap.t_s) // _ROWS))
        way = replace(table, t_s=table.t_s[rows], q=table.q[rows], g_mm=table.g_mm[rows], u_t_s=None)
        inside = way.t_s >= lap.t_s[0]
        phi = np.interp(way.t_s[inside], lap.t_s, lap.phi)
        drives = drive_angles(arm_of(rig.robot), way.q[inside])
        q = np.stack([np.interp(PHI, phi, drive, period=2 * np.pi) for drive in drives.T], axis=1)
        bare = cls(rig, way, inside, phi, half_mm, q, np.zeros(2 * len(PHI)))
        return replace(bare, without=bare.nodes(()))

    def nodes(self, effects: tuple[Effect, ...]) -> Array:
        model = model_of(self.rig, effects)
        g_mm = predict(model, self.way, path_of(model, self.way), nominal_setup(self.rig, self.way))[self.inside]
        yaw = link_angle(g_mm[:, 0], g_mm[:, 1], 2 * self.half_mm) * self.half_mm
        return np.concatenate([np.interp(PHI, self.phi, y, period=2 * np.pi) for y in (yaw, g_mm.mean(axis=1))])

    def play(self, axis: int, width_deg: float) -> Array:
        return self.nodes((play_of_joint(axis, width_deg),)) - self.without

    def offset(self, axis: int) -> Array:
        return (self.nodes((turned(axis, _OUT_DEG),)) - self.without) / _OUT_DEG


def _smooth() -> Array:
    """Orders (2 NODES, orders) of angle and distance."""
    orders = np.arange(1, _SMOOTH + 1) * PHI[:, None]
    block = np.concatenate([np.ones((len(PHI), 1)), np.cos(orders), np.sin(orders)], axis=1)
    none = np.zeros_like(block)
    return np.block([[block, none], [none, block]])
