"""Radial test: distance between tool and ball on a hemisphere, after Oh 2019, section 2.3.

A reading g at a target puts the tool's ball at B + (R + g) × the target's direction, in the hemisphere's frame: z to
its middle (polar 0), x to azimuth 0. Per target, the mean and the range over the tool orientations are computed; the
least-squares sphere is fitted to the means.

A target is only left out if no robot error can explain it, because robot errors are the subject: backlash makes a few
targets differ by much more than the rest. So one of its readings must be (1) more than 2 mm and (2) more than ten
robust standard deviations of all readings (scaled median of absolute residuals) from a sphere fitted with the soft_l1
loss, hardly affected by a few bad readings, and (3) this may concern at most one target in ten (or a single one). A
wrong position affects all orientations, a gauge slip only one. Otherwise every target stays.

Differences between targets and orientations are robot errors; differences between visits are noise. Repeated visits of
a target and orientation determine the noise at each target (`analysis.runs.noise.target_scatter`); otherwise it is
assumed. Every figure refers to the mean positions of the targets: its value is the expectation over draws of these
positions, and value ± 2 u contains 95 % of them. So a range is never negative and not biased by noise. A drift seen in
the visits is removed. A length then refers to the middle of the run, but may be needed for its start: the drift in
between is included in its uncertainty, as a distribution concentrated at both ends (JCGM 101, 6.4.6).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.procedures.shared.lap_curve import SEED
from analysis.procedures.shared.quantity import Quantity
from analysis.procedures.shared.result_curves import RadialCurve
from analysis.procedures.shared.scatter_figures import assumed, coarse, half_width, of_scatter, rp
from analysis.procedures.shared.test_kind import (
    Instruments,
    Labels,
    Simulation,
    check_numbers,
    check_radius,
    require_live_gauges,
)
from analysis.procedures.simulate import read_by_gauges, visit_times
from analysis.procedures.stops import TargetTest, require_known_targets, target_count, visit_starts
from analysis.robot.geometry.driven_programs import hemisphere_of, radial_program
from analysis.robot.kinematics.arm import Array, Integers, Mask
from analysis.runs.align import Aligned
from analysis.runs.noise.certificate import link_excess_mm
from analysis.runs.noise.readings import MOST, SPREADS, robust_sd, step_of_stops
from analysis.runs.noise.target_scatter import Scatter, SphereLevel, scatter_of
from analysis.runs.stands import at_targets, stands_of, visits_of
from analysis.runs.tables import RadialTable
from rigs.errors import FileError
from rigs.readiness import require_test
from rigs.rig import Rig
from rigs.schema.declared_tests import Hemisphere
from rigs.schema.vocabulary import Direction
from rigs.text import listed

PARAMETERS = ("centre_x_mm", "centre_y_mm", "centre_z_mm", "radius_mm")
"""Parameters of a sphere, in order of the design columns."""
_GROSS_MM = 2.0
"""Larger than the largest backlash in the paper (Oh 2019, figure 15: 1.567 mm)."""
_FEWEST_POINTS = 6
_WEAK = 0.01
"""Relative singular value below which a parameter direction is undetermined."""
_STEPS, _ROBUST_STEPS = 6, 30
"""Number of Gauss-Newton steps, and of robust steps.

For points within a hundredth of the radius three steps are sufficient; robust weights need more.
"""


@dataclass(frozen=True)
class Sphere:
    """centre (3,) mm; radius mm; residual (n,) mm: distance of each point from the centre less the radius.

    slopes (4, n): derivatives of `PARAMETERS` by each distance. design (n, 4): the inverse derivatives. unknown: names
    of undetermined parameters, which stay near their start.
    """

    centre: Array
    radius: float
    residual: Array
    slopes: Array
    design: Array
    unknown: tuple[str, ...]


def free_sphere(points: Array) -> Sphere:
    x = np.append(np.zeros(3), np.linalg.norm(points, axis=1).mean())
    for _ in range(_STEPS):
        x = x + _slopes(_design(points, x[:3])) @ _distances_from_sphere(points, x)
    design = _design(points, x[:3])
    return Sphere(x[:3], float(x[3]), _distances_from_sphere(points, x), _slopes(design), design, _unknown(design))


def conditioned(points: Array) -> bool:
    """True if points (n, 3) mm determine centre and radius: not all near one circle or position."""
    return not _unknown(_design(points, np.zeros(3)))


def outlying_targets(points: Array) -> NDArray[np.bool_]:
    """Mask (t,) of outliers of a robust sphere; points (t, o, 3) mm, NaN if missing."""
    # Robust sphere: soft_l1 by reweighting.
    read = points[np.isfinite(points).all(axis=-1)]
    x = np.append(np.zeros(3), np.median(np.linalg.norm(read, axis=1)))
    for _ in range(_ROBUST_STEPS):
        off, design = _distances_from_sphere(read, x), _design(read, x[:3])
        root = (1 + (off / max(_spread(off), 1e-6)) ** 2) ** -0.25
        x = x + _slopes(design * root[:, None]) @ (off * root)
    distance = _distances_from_sphere(points, x)
    gross = max(_GROSS_MM, SPREADS * _spread(distance[np.isfinite(distance)]))
    far = np.any(np.abs(distance) > gross, axis=1)
    means = np.nanmean(points[~far], axis=1)
    if far.sum() > max(1, MOST * len(far)) or len(means) < _FEWEST_POINTS or not conditioned(means):
        return np.zeros(len(points), dtype=bool)
    return np.asarray(far)


def _distances_from_sphere(points: Array, x: Array) -> Array:
    return np.asarray(np.linalg.norm(points - x[:3], axis=-1) - x[3])


def _design(points: Array, centre: Array) -> Array:
    line = points - centre
    unit = line / np.linalg.norm(line, axis=1)[:, None]
    return np.concatenate([unit, np.ones((len(points), 1))], axis=1)


def _slopes(design: Array) -> Array:
    return np.asarray(np.linalg.pinv(design, rcond=_WEAK), dtype=float)


def _unknown(design: Array) -> tuple[str, ...]:
    _, s, V = np.linalg.svd(design, full_matrices=False)
    share = (V[s < _WEAK * s[0]] ** 2).sum(axis=0)
    return tuple(name for name, hidden in zip(PARAMETERS, share, strict=True) if hidden > _WEAK)


def _spread(residual: Array) -> float:
    return robust_sd(np.abs(residual - np.median(residual)))


_FEWEST = 6
_RANGES = frozenset({"band_mm", "held_band_mm", "spread_mm", "spread_mean_mm", "ap_mm"})
_RP_VISITS = 3
_APART = 0.2
"""Visits separated by this share of the run are rounds."""


@dataclass(frozen=True)
class Cells:
    """Readings by target and orientation. target (t,); direction (t, 3): unit vectors in the hemisphere's frame;
    g_mm (t, o, r): mm, with r visits; t_s: times of the visits. Missing values are NaN.
    """

    target: Integers
    direction: Array
    g_mm: Array
    t_s: Array

    @property
    def by_orientation(self) -> Array:
        return _mean(self.g_mm)

    @property
    def rounds(self) -> bool:
        """True if the visits of a target are separated in time."""
        visited = np.isfinite(self.t_s)
        first = np.where(visited, self.t_s, np.inf).min(axis=-1)
        last = np.where(visited, self.t_s, -np.inf).max(axis=-1)
        apart = (last - first)[visited.any(axis=-1)]
        return bool(np.median(apart) > _APART * (last.max() - first.min()))

    def only(self, rows: NDArray[np.bool_]) -> Cells:
        return Cells(self.target[rows], self.direction[rows], self.g_mm[rows], self.t_s[rows])


@dataclass(frozen=True)
class RadialResult:
    """Result of a radial test. cells: of all targets. spread_mm (t,): per target. used (t,): False if excluded.
    points (t, 3): mm from the ball. free: sphere through the used points. scatter: of the visits, None for exact
    readings.
    """

    cells: Cells
    spread_mm: Array
    used: NDArray[np.bool_]
    points: Array
    free: Sphere
    scatter: Scatter | None
    figures: dict[str, Quantity]
    samples: int
    notes: tuple[str, ...]

    @property
    def deviation_mm(self) -> Array:
        return np.asarray(np.linalg.norm(self.points - self.free.centre, axis=1) - self.free.radius)

    @property
    def as_curve(self) -> RadialCurve:
        x, y, z = self.cells.direction.T
        polar_deg, azimuth_deg = np.degrees(np.arccos(np.clip(z, -1.0, 1.0))), np.degrees(np.arctan2(y, x))
        return RadialCurve(self.cells.target, polar_deg, azimuth_deg, self.deviation_mm, self.spread_mm, self.used)


def evaluate(
    table: RadialTable,
    radius_mm: float,
    u_mm: float,
    where: str = "the radial run",
    expected: Collection[int] = (),
    orientations: int = 1,
) -> RadialResult:
    """Figures of a hemisphere.

    radius_mm: nominal. u_mm: standard uncertainty of a gauge reading without its step, 0 for exact (simulated)
    readings.
    expected: numbers of the planned targets. orientations: planned number per target.

    figures: radius_mm and centre_x_mm, _y, _z (from the ball) of the least-squares sphere, without undetermined ones,
    and band_mm about it; held_radius_mm and held_band_mm with the centre at the ball; spread_mm and spread_mean_mm,
    largest and mean range over several orientations; ap_mm, largest |mean g| of a target (ISO 9283 AP along the
    radius); for targets with three visits, rp_mm and rp_mean_mm. Raises FileError.
    """
    check_radius(where, radius_mm)
    cells = _cells(table, radius_mm, where)
    measured = cells.by_orientation
    if len(measured) < _FEWEST:
        problem = f"has {len(measured)} targets, too few for a sphere"
        raise FileError(where, problem, f"measure at least {_FEWEST}, well apart", code="readings.too_few")
    readings = (radius_mm + cells.g_mm.reshape(len(measured), -1))[..., None] * cells.direction[:, None, :]
    far = outlying_targets(readings)
    used = cells.only(~far)
    scatter = None
    if u_mm > 0:
        level = SphereLevel.at(used.direction, measured.shape[1])
        times = used.t_s if _has_time(table.t_s) or used.rounds else None
        scatter = scatter_of(used.g_mm, u_mm, times, level, step_of_stops(table.g_mm))
        measured[~far] = np.where(np.isfinite(measured[~far]), scatter.best_mm, np.nan)
    points = (radius_mm + _mean(measured))[:, None] * cells.direction
    free = free_sphere(points[~far])
    figures = _figures(used, measured[~far], free, scatter, radius_mm)
    off_mm = np.linalg.norm(readings - free.centre, axis=-1) - free.radius
    notes = (*_notes(cells, expected, orientations, far, off_mm, free), *assumed(scatter), *coarse(scatter))
    spread = np.nanmax(measured, axis=1) - np.nanmin(measured, axis=1)
    samples = int(np.isfinite(used.g_mm).sum())
    return RadialResult(cells, spread, ~far, points, free, scatter, figures, samples, notes)


def _figures(cells: Cells, best: Array, free: Sphere, scatter: Scatter | None, radius_mm: float) -> dict[str, Quantity]:
    samples = int(np.isfinite(cells.g_mm).sum())
    plain = {name: float(value[0]) for name, value in _plain(best[None], best, free, radius_mm).items()}
    if scatter is None:
        return {name: Quantity(value, 0.0, "mm", samples) for name, value in plain.items()}
    rng = np.random.default_rng(SEED)
    length = rng.normal(0.0, scatter.drifted_mm / np.sqrt(2.0), len(scatter.cell_mm))
    drawn = _plain(np.where(np.isfinite(best), scatter.cell_mm, np.nan), best, free, radius_mm, length)
    values = {name: float(drawn[name].mean()) if name in _RANGES else value for name, value in plain.items()}
    figures = {name: Quantity(value, half_width(drawn[name] - value), "mm", samples) for name, value in values.items()}
    figures = {name: replace(figure, noise=scatter.noise) for name, figure in figures.items()}
    # RP along the radius, by ISO 9283, 7.2.2, of the attained poses, including drift between visits.
    often = np.isfinite(cells.g_mm).sum(axis=-1) >= _RP_VISITS
    if not often.any():
        return figures

    def largest_and_mean(readings: Array) -> dict[str, Array]:
        repeat = rp(readings[..., often, :, None])
        return {"rp_mm": repeat.max(axis=-1), "rp_mean_mm": repeat.mean(axis=-1)}

    x = np.where(often[..., None], cells.g_mm, np.nan)
    return figures | of_scatter(largest_and_mean, x, scatter, scatter.drift_mm)


def _plain(
    cell_mm: Array, best: Array, free: Sphere, radius_mm: float, length_mm: Array | float = 0.0
) -> dict[str, Array]:
    """Compute the figures (m,) for m drawn sets of readings, so that their spread gives u.

    cell_mm (m, t, o): drawn readings. best (t, o): readings about which they are drawn. length_mm (m,): length added to
    every distance. The sphere is updated by a linear approximation.
    """
    length = np.broadcast_to(length_mm, len(cell_mm))
    mean = _mean(cell_mm)
    moved = mean - _mean(best)
    answer = moved @ free.slopes.T
    residual = free.residual + moved - answer @ free.design.T
    sphere = np.append(free.centre, free.radius) + answer
    sphere[:, 3] += length
    figures = {name: sphere[:, column] for column, name in enumerate(PARAMETERS) if name not in free.unknown}
    figures |= {
        "band_mm": np.ptp(residual, axis=1),
        "held_radius_mm": radius_mm + mean.mean(axis=1) + length,
        "held_band_mm": np.ptp(mean, axis=1),
        "ap_mm": np.abs(mean + length[:, None]).max(axis=1),
    }
    several = np.isfinite(best).sum(axis=1) > 1
    if several.any():
        spread = np.nanmax(cell_mm[:, several], axis=2) - np.nanmin(cell_mm[:, several], axis=2)
        figures |= {"spread_mm": spread.max(axis=1), "spread_mean_mm": spread.mean(axis=1)}
    return figures


def _cells(table: RadialTable, radius_mm: float, where: str) -> Cells:
    if len(table.g_mm) == 0:
        raise FileError(where, "has no rows", "give a table with readings", code="readings.too_few")
    check_numbers(where, g1_mm=table.g_mm, polar=table.polar, azimuth=table.azimuth)
    require_live_gauges(where, g1_mm=table.g_mm)
    if np.abs(table.polar).max() > np.pi + 1e-6 or np.abs(table.azimuth).max() > 2 * np.pi + 1e-6:
        problem = "has targets beyond 180° polar or 360° azimuth"
        raise FileError(where, problem, "check the units of polar_deg and azimuth_deg", code="table.unclear")
    if (most_mm := np.abs(table.g_mm).max()) > 0.5 * radius_mm:
        problem = f"a reading of {most_mm:g} mm is too large for a radius of {radius_mm:g} mm"
        raise FileError(where, problem, "give g1_mm as the distance less the link's set length", code="table.unclear")
    targets, row = np.unique(table.target, return_inverse=True)
    orientations, column = np.unique(table.orientation, return_inverse=True)
    sine, cosine = np.sin(table.polar), np.cos(table.polar)
    direction = np.stack([sine * np.cos(table.azimuth), sine * np.sin(table.azimuth), cosine], axis=1)
    first = np.array([direction[row == k][0] for k in range(len(targets))])
    moved = np.linalg.norm(direction - first[row], axis=1) > 1e-3
    if moved.any():
        target = int(table.target[np.argmax(moved)])
        problem = f"target {target} has two directions"
        raise FileError(where, problem, "give each target a single polar angle and azimuth", code="table.invalid")
    visits: dict[tuple[int, int], list[int]] = {}
    for k, place in enumerate(zip(row.tolist(), column.tolist(), strict=True)):
        visits.setdefault(place, []).append(k)
    g_mm = np.full((len(targets), len(orientations), max(map(len, visits.values()))), np.nan)
    t_s, times = g_mm.copy(), table.t_s if _has_time(table.t_s) else np.arange(len(table.t_s), dtype=float)
    for (target, orientation), rows in visits.items():
        g_mm[target, orientation, : len(rows)] = table.g_mm[rows]
        t_s[target, orientation, : len(rows)] = times[rows]
    return Cells(targets, first, g_mm, t_s)


def _has_time(t_s: Array) -> bool:
    return bool(np.ptp(t_s) > 0)


def _mean(x: Array) -> Array:
    """Mean over the last axis ignoring NaN; NaN without a warning if empty."""
    measured = np.isfinite(x)
    count = measured.sum(axis=-1)
    return np.where(count > 0, np.where(measured, x, 0.0).sum(axis=-1) / np.maximum(count, 1), np.nan)


def _notes(
    cells: Cells, expected: Collection[int], orientations: int, far: NDArray[np.bool_], off_mm: Array, free: Sphere
) -> tuple[str, ...]:
    notes = []
    targets, have = len(cells.target), cells.g_mm.shape[1]
    numbers = set(expected) or set(range(1, int(cells.target.max()) + 1))
    if missing := sorted(numbers - set(cells.target.tolist())):
        notes.append(f"target {listed(missing)} missing: {targets} of {len(numbers)} measured")
    if partial := cells.target[np.isnan(cells.by_orientation).any(axis=1)].tolist():
        notes.append(f"not all {have} orientations were measured at target {listed(partial)}")
    if have < orientations:
        without = ", so their range is not reported" if have == 1 else ""
        notes.append(f"{have} of {orientations} orientations measured{without}")
    most = float(np.nanmax(np.abs(off_mm[~far])))
    for k in np.flatnonzero(far):
        worst = off_mm[k, np.nanargmax(np.abs(off_mm[k]))]
        reading = f"a reading {worst:+z.3f} mm off the sphere, those of the others within {most:.3f} mm"
        notes.append(f"target {cells.target[k]} ignored: {reading}")
    if free.unknown:
        why = "the targets are too close to a plane or place to determine them; measure at more polar angles"
        notes.append(f"{', '.join(free.unknown)} ignored: {why}")
    return tuple(notes)


class Radial(TargetTest[RadialTable]):
    """Distance between tool and ball on a hemisphere."""

    test = "radial"
    labels = Labels(
        example=("band_mm", 0.2, 0.3),
        part="hemisphere",
        further=("hemisphere (radial)", "many postures, by distance alone"),
        along="target",
    )
    table = RadialTable
    fields = ("target", "polar", "azimuth", "orientation", "q", "g_mm")
    optional = ("t_s",)
    gauges = ("g1",)
    certified = ("g1", "ball", "link")

    def stands(self, table: RadialTable) -> Mask:
        return visit_starts(table, np.stack([table.target, table.orientation], axis=1))

    def recorded(
        self, data: Aligned, rig: Rig, direction: Direction | None, where: str
    ) -> tuple[RadialTable, list[str]]:
        stands, program = stands_of(data.t_s, data.q, data.g_mm), radial_program(rig)
        at = at_targets(stands, program, rig)
        order = list(zip(program.target.tolist(), program.orientation.tolist(), strict=True))
        once = len(order) // hemisphere_of(rig).visits
        visits = visits_of(at, [order[row] for _, row in at], order, once, program, where)
        elsewhere, rows = len(stands) - len(at), visits.rows
        doubts = [f"{elsewhere} stops are ignored because they are not at a target"] if elsewhere else []
        table = RadialTable(
            program.target[rows], program.polar[rows], program.azimuth[rows], program.orientation[rows],
            visits.t_s, visits.q, visits.g_mm + link_excess_mm(rig),
        )  # fmt: skip
        return table, doubts + visits.doubts

    def evaluate(self, table: RadialTable, rig: Rig, where: str, instruments: Instruments) -> RadialResult:
        require_known_targets(table, rig, where)
        hemisphere, u_mm = hemisphere_of(rig), instruments.u_mm(rig)
        expected = range(1, target_count(hemisphere) + 1)
        orientations = hemisphere.orientations
        return evaluate(table, hemisphere.radius_mm, u_mm, where, expected, orientations)

    def simulated(self, rig: Rig, direction: Direction | None, run: Simulation) -> RadialTable:
        require_test(rig, self.test)
        at, none = radial_program(rig), np.empty(0)
        table = RadialTable(at.target, at.polar, at.azimuth, at.orientation, visit_times(len(at.q)), at.q, none)
        return table.with_readings(read_by_gauges(rig, table, self.setup(rig), run))

    def directions(self, table: RadialTable, hemisphere: Hemisphere) -> tuple[Array, Array]:
        return table.polar, table.azimuth

    def visits(self, table: RadialTable) -> Integers:
        return np.stack([table.target, table.orientation], axis=1)
