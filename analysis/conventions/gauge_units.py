"""Gauges in another unit: what the two readings on a circle show of one another.

At circle angle phi the mean of the gauges is R - e_u cos(phi) - e_v sin(phi) for an eccentricity e, and each gauge
sees the same e in yaw and roll alike.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from analysis.conventions.off_path import off_path
from analysis.geometry.circle import frame_of
from analysis.kinematics.arm import Array
from analysis.traces.tables import CircleTable
from rigs.rig import Rig
from rigs.schema.declared_tests import Circle

_ECCENTRIC_MM = 0.2
"""A smaller eccentricity may differ between the two by the robot's own errors."""
_LIKE_STATED = 0.3
"""Robots of 0.1 mm make the eccentricity differ from the stated one by less than this share; units, by 25 times it."""
_AS_FAR = 2.0
"""Gauges in one unit travel as far as one another within this factor, and 25 times as far in two."""
FACTORS = {"inches": 1 / 25.4, "µm": 1000.0}
"""What a length in mm reads in another unit."""


def circle_gauges(table: CircleTable, rig: Rig, T: Array) -> Iterator[tuple[str, str]]:
    """What is wrong with the gauges of a circle driven through nominal tool poses T (n, 4, 4), and what to do."""
    circle = rig.tests.circle
    if circle is None:
        return
    for name, reading in zip(("g1_mm", "g2_mm"), table.g_mm.T, strict=False):
        yield from too_far(name, reading, circle.radius_mm)
    off = off_path(T, table, rig)
    if table.g_mm.shape[1] < 2 or rig.gauges.g2 is None or off is None or not off.on:
        return
    waves = _waves(table, T, circle)
    if waves is None:
        return
    yield from _one_other_unit(waves, table.g_mm)
    yield from _both_other_units(waves.mean(axis=0), circle)


def _waves(table: CircleTable, T: Array, circle: Circle) -> Array | None:
    """First harmonic of each gauge (2, 2): minus its cos and sin parts over phi in mm; None for less than a lap.

    That is the eccentricity along phi = 0° and 90°, turned in a yaw test by w/R to either side.
    """
    phi = frame_of(circle).angle(T[:, :3, 3])
    if np.ptp(phi) < 2 * np.pi * 0.9 or len(phi) < 12:
        return None
    design = np.stack([np.ones_like(phi), np.cos(phi), np.sin(phi)], axis=1)
    waves: Array = -np.linalg.lstsq(design, table.g_mm, rcond=None)[0][1:].T
    return waves


def _one_other_unit(waves: Array, g_mm: Array) -> Iterator[tuple[str, str]]:
    """Both gauges (n, 2) follow the one ball, and so see waves of the same size that point to the same side, and travel
    as far: errors of a robot may cancel the wave of one gauge, but not what else it shows."""
    low, high = np.quantile(g_mm, [0.05, 0.95], axis=0)  # a chip under a probe is no travel
    travel = high - low
    size = np.linalg.norm(waves, axis=1)
    if size.min() <= 0 or size.max() < _ECCENTRIC_MM or waves[0] @ waves[1] < 0:
        return
    for unit, factor in FACTORS.items():
        for k, ratio in enumerate((size[0] / size[1], size[1] / size[0])):
            as_far = 1 / _AS_FAR < travel[k] / factor / max(travel[1 - k], 1e-9) < _AS_FAR
            if abs(ratio / factor - 1) < 0.1 and as_far:
                what = f"g{k + 1}_mm is in {unit}: its wave over the circle is {ratio:.3g} times the other gauge's"
                yield what, "convert it to mm"


def _both_other_units(wave: Array, circle: Circle) -> Iterator[tuple[str, str]]:
    """Where the rig file states the eccentricity: the data show the same one, in another unit."""
    frame = frame_of(circle)
    stated_mm = np.array([np.dot(circle.eccentricity_mm, frame.u), np.dot(circle.eccentricity_mm, frame.v)])
    if np.linalg.norm(stated_mm) < _ECCENTRIC_MM:
        return
    for unit, factor in FACTORS.items():
        if np.linalg.norm(wave / factor - stated_mm) < _LIKE_STATED * np.linalg.norm(stated_mm):
            what = f"g1_mm and g2_mm are in {unit}: their wave is the rig file's eccentricity times {factor:.3g}"
            yield what, "convert them to mm"


def too_far(name: str, reading: Array, radius_mm: float) -> Iterator[tuple[str, str]]:
    """What is wrong, and the remedy, if a reading (n,) mm travels further than the radius: a link cannot."""
    travel = float(np.ptp(reading))
    if travel > radius_mm:
        what = f"{name} travels {travel:.4g} mm on a radius of {radius_mm:g} mm, which is impossible for a link"
        yield what, "convert it to mm: it looks like µm" if travel > 3 * radius_mm else "check its unit"
