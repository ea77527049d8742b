"""The play of each joint in a circle run: how far the readings jump where the joint turns back.

Play is all that makes the lap jump where a joint turns back; the rest of a robot's error is smooth along the lap. The
angle and the distance of a lap are therefore fitted by low orders and, for each joint that turns back, by the readings
that the model gives for a play there less those without: linear least squares, one size a joint. Where gravity holds
the gears on one side, no jump shows and the figure is near zero. Source: Y. T. Oh, Applied Sciences 9 (2019), 3.2.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.geometry.ball_link import angle
from analysis.kinematics.arm import Array
from analysis.measures.joint_reversals import turns
from analysis.measures.link_angle import CircleResult
from analysis.measures.quantity import Quantity
from analysis.measures.reduction import PHI, nodes_of
from analysis.measures.results import Result
from analysis.model.predict import model_of, nominal_setup, path_of, predict
from analysis.traces.laps import Laps
from analysis.traces.tables import CircleTable
from rigs.effects import Backlash, Effect
from rigs.rig import Rig

_SMOOTH = 12
"""Orders that count as smooth: offsets, links and set-up make orders up to 3, eccentric gears some more."""
_WIDTH_DEG = 0.01
"""The play that the jumps are first computed with, then with those found: a wide play is crossed over some degrees."""
_NARROWEST_DEG = 0.002
"""Jumps of narrower plays are as sharp as a lap shows them."""
_PASSES = 3
_ROWS = 3000
"""Rows of a lap that the model is computed for: four a node."""
_WORST_U_DEG = 0.05
"""A play known no better than this is left out: its jumps are too small, or too close to those of another joint."""


def joint_plays(result: Result) -> dict[str, Quantity]:
    """`play_j1_deg` … of the joints that turn back, of a yaw or roll run; nothing for other tests.

    u holds the noise within the run and what the fit leaves unexplained.
    """
    found, table = result.found, result.measured.table
    if not isinstance(found, CircleResult) or not isinstance(table, CircleTable):
        return {}
    axes = sorted({turn.axis for turn in turns(found.laps)})
    if not axes:
        return {}
    half_mm = result.measured.rig.gauges.baseline_mm / 2
    curves = np.concatenate([found.curve.y * half_mm, found.distance.curve.y])
    errors = np.concatenate([found.curve.errors * half_mm, found.distance.curve.errors], axis=1)
    widths_deg = np.full(len(axes), _WIDTH_DEG)
    for _ in range(_PASSES):
        columns = _jumps(found.laps, table, result.measured.rig, dict(zip(axes, widths_deg, strict=True)), half_mm)
        design = np.concatenate([columns, _smooth()], axis=1)
        solve = np.linalg.pinv(design)
        sizes = solve @ curves
        widths_deg = np.maximum(sizes[: len(axes)], _NARROWEST_DEG)
    left = curves - design @ sizes
    # Neighbouring nodes err alike: a jump is judged by about as many independent ones as there are orders in 10°.
    of_fit = np.sqrt((solve**2).sum(axis=1) * float(left.var()) * len(PHI) / 72)
    u = np.hypot((errors @ solve.T).std(axis=0), of_fit)
    return {
        f"play_j{axis}_deg": Quantity(float(sizes[k]), float(u[k]), "deg", found.samples, found.curve.noise.source)
        for k, axis in enumerate(axes)
        if u[k] < _WORST_U_DEG
    }


def _jumps(laps: Laps, table: CircleTable, rig: Rig, widths_deg: dict[int, float], half_mm: float) -> Array:
    """Angle and distance (2 NODES, axes) mm for each degree of plays of these widths, by axis, along the first lap."""
    lap = laps.first
    rows = slice(None, None, max(1, len(lap.t_s) // _ROWS))
    one = replace(table, t_s=lap.t_s[rows], q=lap.q[rows], g_mm=lap.g_mm[rows])
    phi = lap.phi[rows]

    def nodes(effects: tuple[Effect, ...]) -> Array:
        model = model_of(rig, effects)
        g_mm = predict(model, one, path_of(model, one), nominal_setup(rig, one))
        turned = angle(g_mm[:, 0], g_mm[:, 1], 2 * half_mm) * half_mm
        return np.concatenate([nodes_of(phi, turned), nodes_of(phi, g_mm.mean(axis=1))])

    without = nodes(())
    plays = [(nodes((Backlash(axis=axis, width_deg=width),)) - without) / width for axis, width in widths_deg.items()]
    return np.stack(plays, axis=1)


def _smooth() -> Array:
    """Low orders (2 NODES, orders), of length 1, of angle and distance, each its own."""
    orders = np.arange(1, _SMOOTH + 1) * PHI[:, None]
    one = np.concatenate([np.ones((len(PHI), 1)), np.cos(orders), np.sin(orders)], axis=1)
    none = np.zeros_like(one)
    return np.block([[one, none], [none, one]])
