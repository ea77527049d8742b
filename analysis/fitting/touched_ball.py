"""Where a fixed ball is, by the places of the tool while it touched the ball or a link held it at one distance.

The tool's point stands at four or more places on a sphere about the ball, of a radius that need not be known. Where a
gauge on the link was read, what it read more is taken off each distance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.fitting.stood_points import distinct, scatter
from analysis.kinematics.arm import Array, Mask, arm_of, forward
from analysis.traces.align import align, robot_alone
from analysis.traces.csv_tables import table_from
from analysis.traces.stands import stands_of
from analysis.traces.tables import RadialTable, RepeatabilityTable
from daq.store import Run
from rigs.edit import Values
from rigs.errors import FileError
from rigs.rig import Rig

_ROUNDS = 20
"""Gauss-Newton steps from the algebraic fit; a short cap of a sphere takes most of them."""
_OFF_MM = 10.0
"""An arm's errors bend a hemisphere by some mm; a stand further off is not on it."""
_OTHERS = 1 / 8
"""Share of stands that may be elsewhere: at home before the program and after it."""
_GAUGE_MM = 5.0
"""The ball must be in the hemisphere's centre within what a gauge reads to either side: 2 u must stay within."""


@dataclass(frozen=True)
class TouchedBall:
    """centre (3,) mm; covariance (3, 3) mm²; radius_mm and its u of the sphere on which the tool was; q (m, 6) rad and
    places (m, 3) mm of the stands; used: what it was fitted to; doubts in words."""

    centre: Array
    covariance: Array
    radius_mm: float
    u_radius_mm: float
    q: Array
    places: Array
    used: str
    doubts: tuple[str, ...]

    @property
    def u_centre_mm(self) -> Array:
        """Standard uncertainty (3,) mm of the centre's coordinates."""
        return np.sqrt(np.diag(self.covariance))

    def values(self, rig: Rig) -> Values:
        """The keys of tests.hemisphere: the centre, and what else a rig file without a hemisphere lacks."""
        values: dict[str, float | list[float]] = {"centre_mm": [round(float(x), 3) for x in self.centre]}
        if rig.tests.hemisphere is None:
            pole = int((self.places - self.centre)[:, 2].argmax())  # its normal points upwards unless stated
            values["radius_mm"] = round(self.radius_mm, 3)
            values["posture_deg"] = [round(float(x), 2) for x in np.degrees(self.q[pole])]
        return values


def touched_ball(runs: Sequence[Run], rig: Rig) -> TouchedBall:
    """The ball about which the robot stood in all runs. Raises FileError for fewer than four places, or for places that
    determine no sphere."""
    where = ", ".join(str(run.path) for run in runs)
    stands, doubts = zip(*(_stands(run, rig) for run in runs), strict=True)
    q, g_mm, within = (np.concatenate(parts) for parts in zip(*stands, strict=True))
    places = forward(arm_of(rig.robot), q)[:, :3, 3]
    if (apart := len(distinct(places))) < 4:
        what = f"the robot stood at {apart} places, and a ball needs four that are not in one plane"
        raise FileError(where, what, "stand at more places all over the hemisphere, a second at each")
    near = _near_one_sphere(places, g_mm)
    others = len(q) - int(near.sum())
    q, g_mm, within, places = q[near], g_mm[near], within[near], places[near]
    x, design = _sphere(places, g_mm)
    left = _off(places, g_mm, x)
    if not np.isfinite(x).all() or np.linalg.cond(design) > 1e6:
        raise FileError(where, "the stands lie in one plane, which determines no ball", "stand higher and lower too")
    if np.abs(left).max() > _OFF_MM:
        worst = int(np.abs(left).argmax())
        what = f"stand {worst + 1} of {len(left)} lies {abs(left[worst]):.1f} mm off one sphere about the ball"
        raise FileError(where, what, "record only stands at which the link or the ball held the tool")
    scatter_mm, more = scatter(float((left**2).sum()), len(left) - 4, float(np.sqrt(np.mean(within**2))))
    covariance: Array = np.asarray(scatter_mm**2 * np.linalg.inv(design.T @ design), dtype=np.float64)
    used = f"{len(q)} stands on a sphere of {x[3]:.1f} mm"
    if 2 * (u_mm := float(np.sqrt(np.diag(covariance)[:3]).max())) > _GAUGE_MM:
        what = f"{used} leave the ball uncertain by {u_mm:.3g} mm (u)"
        raise FileError(where, what, "stand at places further apart, all over the hemisphere")
    said = tuple(doubt for one in doubts for doubt in one) + more
    if others:
        said = (*said, f"{others} stands are not used because they lie off the sphere of the others")
    return TouchedBall(x[:3], covariance[:3, :3], float(x[3]), float(np.sqrt(covariance[3, 3])), q, places, used, said)


def _stands(run: Run, rig: Rig) -> tuple[tuple[Array, Array, Array], tuple[str, ...]]:
    """Angles (m, 6) rad, readings (m,) mm, 0 without a gauge, and scatter (m,) mm within each of a run's stands."""
    path, manifest = run.path, run.manifest
    if run.table is not None:
        table = table_from(run.table, manifest.test, manifest.direction, str(path))
        if not isinstance(table, RadialTable | RepeatabilityTable):
            raise FileError(str(path), f"is a {manifest.test} table, without stands about a ball", "give a radial run")
        return (table.q, table.g_mm, np.zeros(len(table.q))), ()
    doubts: tuple[str, ...] = ()
    try:
        data = align(path, run, rig)
        t_s, q, g_mm, doubts = data.t_s, data.q, data.g_mm[:, :1], data.doubts
    except FileError as error:
        t_s, q, said = robot_alone(path, run)
        g_mm = np.zeros((len(t_s), 1))
        doubts = (*said, f"without gauge g1 ({error.what}) all distances from the ball are taken as equal")
    stands = stands_of(t_s, q, g_mm)
    arm = arm_of(rig.robot)
    within = [forward(arm, q[one.settled])[:, :3, 3].std(axis=0).mean() for one in stands]
    angles = np.array([one.q for one in stands]).reshape(-1, 6)
    return (angles, np.array([one.g_mm[0] for one in stands]), np.array(within)), doubts


def _near_one_sphere(places: Array, g_mm: Array) -> Mask:
    """A mask of the places (m, 3) mm without the few that lie far off the sphere of the others, one after the other."""
    near = np.ones(len(places), dtype=bool)
    for _ in range(int(_OTHERS * len(places))):
        off = np.abs(_off(places, g_mm, _sphere(places[near], g_mm[near])[0])) * near
        if off.max() < _OFF_MM:
            break
        near[int(off.argmax())] = False
    return near


def _off(places: Array, g_mm: Array, x: Array) -> Array:
    """Distance (m,) mm of places (m, 3) mm from the sphere x (4,)."""
    away: Array = np.linalg.norm(places - x[:3], axis=1) - g_mm - x[3]
    return away


def _sphere(places: Array, g_mm: Array) -> tuple[Array, Array]:
    """Centre and radius (4,) mm with |p - B| = R + g, and the slopes (m, 4) of the distances by them."""
    middle = places.mean(axis=0)
    from_middle = places - middle
    algebraic = np.column_stack([2 * from_middle, np.ones(len(places))])
    x = np.linalg.lstsq(algebraic, (from_middle**2).sum(axis=1), rcond=None)[0]
    x = np.append(middle + x[:3], np.sqrt(max(x[3] + x[:3] @ x[:3], 1.0)))
    for _ in range(_ROUNDS):
        design, left = _slopes(places, g_mm, x)
        x = x + np.linalg.lstsq(design, left, rcond=None)[0]
    return x, _slopes(places, g_mm, x)[0]


def _slopes(places: Array, g_mm: Array, x: Array) -> tuple[Array, Array]:
    away = places - x[:3]
    distance = np.linalg.norm(away, axis=1)
    design = np.column_stack([away / np.maximum(distance, 1e-9)[:, None], np.ones(len(places))])
    return design, distance - g_mm - x[3]
