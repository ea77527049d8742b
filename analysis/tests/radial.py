"""Radial test: the distance of tool and ball on a hemisphere, after Oh 2019, section 2.3.

A reading g at a target puts the tool's ball at B + (R + g) × the target's direction, in the hemisphere's frame: z
to its middle (polar 0), x to azimuth 0. Per target, the mean and the range over the tool's orientations; the
means make the sphere.

That targets and orientations differ is the robot's error, and no noise. The uncertainty of a figure is that of
the measurement, for these targets as they stood: how much it would vary if the gauge read the same positions
again. One reading has the gauge's uncertainty or, where targets were visited again in the same orientation and that
scatter is larger, the pooled scatter of the visits. It says nothing of other targets, and on its own nothing of
the robot's repeatability where nothing was visited twice. Ranges are corrected for what noise adds to them.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.kinematics.arm import Array
from analysis.noise.spectrum import DRAWS
from analysis.reading.tables import Integers, RadialTable
from analysis.reporting.quantity import Quantity, figures_of
from analysis.tests.checks import hold_alive, hold_numbers, hold_radius, listed
from analysis.tests.curve import SEED
from analysis.tests.sphere import Sphere, conditioned, far_off, free_sphere
from analysis.tests.standards import pooled_sd, rp
from rigs.errors import FileError

_FEWEST = 6
_RANGES = frozenset({"band_mm", "held_band_mm", "spread_mm", "spread_mean_mm", "ap_mm"})


@dataclass(frozen=True)
class Cells:
    """Readings by target and orientation. target (t,); direction (t, 3) unit vectors in the hemisphere's frame;
    g_mm (t, o, r) mm of r visits, NaN where there is none."""

    target: Integers
    direction: Array
    g_mm: Array

    @property
    def by_orientation(self) -> Array:
        """Mean (t, o) over visits, NaN where there is none."""
        return _mean(self.g_mm)

    @property
    def by_visit(self) -> Array:
        """Every reading (t, o·r) of a target, NaN where there is none."""
        return self.g_mm.reshape(len(self.g_mm), -1)

    def only(self, rows: NDArray[np.bool_]) -> Cells:
        """Without the other targets."""
        return Cells(self.target[rows], self.direction[rows], self.g_mm[rows])


@dataclass(frozen=True)
class Radial:
    """cells: of all targets; spread_mm (t,) of each; used (t,): False where left out; points (t, 3) mm from
    the ball; free: the sphere through the used points."""

    cells: Cells
    spread_mm: Array
    used: NDArray[np.bool_]
    points: Array
    free: Sphere
    figures: dict[str, Quantity]
    samples: int
    notes: tuple[str, ...]


def evaluate(
    table: RadialTable,
    radius_mm: float,
    u_mm: float,
    where: str = "the radial run",
    expected: Collection[int] = (),
    u_link_mm: float = 0.0,
) -> Radial:
    """radius_mm: nominal; u_mm: standard uncertainty of one reading, u_link_mm of the link's set length, which all
    readings share; expected: numbers of the targets that were to be measured.

    figures: radius_mm and centre_x_mm, _y, _z (from the ball) of the least-squares sphere, band_mm about it;
    held_radius_mm and held_band_mm with the centre held at the ball; spread_mm and spread_mean_mm, largest and mean
    range over orientations where there are several; ap_mm, largest |mean g| of a target (ISO 9283 AP along the
    radius); where targets were visited three times, rp_mm and rp_mean_mm. Raises FileError.
    """
    hold_radius(where, radius_mm)
    _hold(table, radius_mm, where)
    cells = _cells(table, where)
    points = (radius_mm + _mean(cells.by_orientation))[:, None] * cells.direction
    _hold_sphere(points, where)
    readings = (radius_mm + cells.by_visit)[..., None] * cells.direction[:, None, :]
    far = far_off(readings)
    used = cells.only(~far)
    free = free_sphere(points[~far])
    scatter, freedom = pooled_sd(used.g_mm.reshape(-1, used.g_mm.shape[-1], 1))
    u = max(u_mm, scatter)
    values, draws = _drawn(used, free, radius_mm, u, u_link_mm)
    samples = int(np.isfinite(used.g_mm).sum())
    figures = figures_of(values, draws, samples, {name: values[name] for name in _RANGES & values.keys()})
    figures |= _repeatability(used, scatter, freedom)
    means = cells.by_orientation
    notes = _missing(cells, expected) + _left_out(cells, far, readings, free)
    spread = np.nanmax(means, axis=1) - np.nanmin(means, axis=1)
    return Radial(cells, spread, ~far, points, free, figures, samples, notes)


def _drawn(
    cells: Cells, free: Sphere, radius_mm: float, u: float, u_link_mm: float
) -> tuple[dict[str, float], dict[str, Array]]:
    """The figures, and m draws (m,) of each about the readings. The sphere answers to noise by its slopes."""
    rng = np.random.default_rng(SEED)
    visits = np.isfinite(cells.g_mm).sum(axis=-1)
    there = visits > 0
    u_cell = np.where(there, u / np.sqrt(np.maximum(visits, 1)), np.nan)
    noise = np.concatenate([np.zeros((1, *u_cell.shape)), rng.standard_normal((DRAWS, *u_cell.shape))]) * u_cell
    link = np.append(0.0, rng.normal(0.0, u_link_mm, DRAWS))
    by_orientation = cells.by_orientation + noise
    shift = _mean(noise)  # (m + 1, t) of each target's mean
    answer = shift @ np.linalg.pinv(free.design).T
    residual = free.residual + shift - answer @ free.design.T
    distance = radius_mm + _mean(by_orientation)
    every = {
        "radius_mm": free.radius + answer[:, 3] + link,
        "centre_x_mm": free.centre[0] + answer[:, 0],
        "centre_y_mm": free.centre[1] + answer[:, 1],
        "centre_z_mm": free.centre[2] + answer[:, 2],
        "band_mm": np.ptp(residual, axis=1),
        "held_radius_mm": distance.mean(axis=1) + link,
        "held_band_mm": np.ptp(distance, axis=1),
        "ap_mm": np.abs(distance + link[:, None] - radius_mm).max(axis=1),
    }
    if cells.g_mm.shape[1] > 1:
        spread = np.nanmax(by_orientation, axis=-1) - np.nanmin(by_orientation, axis=-1)
        every |= {"spread_mm": spread.max(axis=1), "spread_mean_mm": spread.mean(axis=1)}
    return {name: float(draws[0]) for name, draws in every.items()}, {name: draws[1:] for name, draws in every.items()}


def _repeatability(cells: Cells, scatter: float, freedom: int) -> dict[str, Quantity]:
    """RP along the radius where there are three visits or more; its uncertainty as in the repeatability test."""
    x = cells.g_mm.reshape(-1, cells.g_mm.shape[-1])
    x = x[np.isfinite(x).sum(axis=1) >= 3]
    if len(x) == 0 or freedom == 0:
        return {}
    noise = scatter * np.random.default_rng(SEED).standard_normal((DRAWS, *x.shape))
    drawn, found = rp(np.where(np.isfinite(x), noise, np.nan)[..., None]), rp(x[..., None])
    values = {"rp_mm": float(found.max()), "rp_mean_mm": float(found.mean())}
    draws = {"rp_mm": drawn.max(axis=1), "rp_mean_mm": drawn.mean(axis=1)}
    return figures_of(values, draws, int(np.isfinite(x).sum()))


def _cells(table: RadialTable, where: str) -> Cells:
    targets, row = np.unique(table.target, return_inverse=True)
    orientations, column = np.unique(table.orientation, return_inverse=True)
    direction = _direction(table.polar, table.azimuth)
    first = np.array([direction[row == k][0] for k in range(len(targets))])
    moved = np.linalg.norm(direction - first[row], axis=1) > 1e-3
    if moved.any():
        target = int(table.target[np.argmax(moved)])
        raise FileError(where, f"target {target} has two directions", "give each target one polar and one azimuth")
    visits: dict[tuple[int, int], list[float]] = {}
    for place, g in zip(zip(row.tolist(), column.tolist(), strict=True), table.g_mm.tolist(), strict=True):
        visits.setdefault(place, []).append(g)
    g_mm = np.full((len(targets), len(orientations), max(map(len, visits.values()))), np.nan)
    for (target, orientation), readings in visits.items():
        g_mm[target, orientation, : len(readings)] = readings
    return Cells(targets, first, g_mm)


def _direction(polar: Array, azimuth: Array) -> Array:
    """Unit vectors (n, 3) in the hemisphere's frame."""
    return np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=1)


def _mean(x: Array) -> Array:
    """Mean over the last axis of what is there; NaN, without a warning, where nothing is."""
    there = np.isfinite(x)
    count = there.sum(axis=-1)
    values: Array = np.where(count > 0, np.where(there, x, 0.0).sum(axis=-1) / np.maximum(count, 1), np.nan)
    return values


def _missing(cells: Cells, expected: Collection[int]) -> tuple[str, ...]:
    notes = []
    wanted = set(expected) or set(range(1, int(cells.target.max()) + 1))
    missing = sorted(wanted - set(cells.target.tolist()))
    if missing:
        notes.append(f"target {listed(missing)} missing: {len(cells.target)} of {len(wanted)} measured")
    partial = cells.target[np.isnan(cells.by_orientation).any(axis=1)].tolist()
    if partial:
        notes.append(f"target {listed(partial)} without all {cells.g_mm.shape[1]} orientations")
    return tuple(notes)


def _left_out(cells: Cells, far: NDArray[np.bool_], readings: Array, free: Sphere) -> tuple[str, ...]:
    """readings (t, o, 3) mm from the ball."""
    off = np.linalg.norm(readings - free.centre, axis=-1) - free.radius
    rest = float(np.nanmax(np.abs(off[~far])))
    return tuple(
        f"target {cells.target[k]} left out: a reading {off[k, np.nanargmax(np.abs(off[k]))]:+.3f} mm off the sphere, "
        f"those of the others within {rest:.3f} mm"
        for k in np.flatnonzero(far)
    )


def _hold(table: RadialTable, radius_mm: float, where: str) -> None:
    if len(table.g_mm) == 0:
        raise FileError(where, "has no rows", "give a table with readings")
    hold_numbers(where, g1_mm=table.g_mm, polar=table.polar, azimuth=table.azimuth)
    hold_alive(where, g1_mm=table.g_mm)
    if np.abs(table.polar).max() > np.pi + 1e-6 or np.abs(table.azimuth).max() > 2 * np.pi + 1e-6:
        raise FileError(where, "has targets beyond 180° polar or 360° azimuth", "see the units of polar and azimuth")
    if np.abs(table.g_mm).max() > 0.5 * radius_mm:
        raise FileError(
            where,
            f"a reading of {table.g_mm[np.argmax(np.abs(table.g_mm))]:g} mm is no deviation from {radius_mm:g} mm",
            "give g1_mm as the distance less the link's set length",
        )


def _hold_sphere(points: Array, where: str) -> None:
    if len(points) < _FEWEST:
        raise FileError(
            where, f"has {len(points)} targets, too few for a sphere", f"measure at least {_FEWEST}, well apart"
        )
    if not conditioned(points):
        raise FileError(
            where,
            "the targets lie near one circle or place, which tells no sphere",
            "measure targets at different polar angles too",
        )
