"""Residuals above the noise: orders, targets and places on the circle, and the curves for plots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
import pyarrow as pa

from analysis.diagnosis.evidence.blocks import BAND_EDGES, Block
from analysis.diagnosis.evidence.observation import GRID, ORDER_OF, curve
from analysis.procedures.shared.result_curves import turns
from analysis.procedures.shared.test_kind import facts_of, kind_of, labels_of
from analysis.robot.kinematics.arm import Array, Integers
from analysis.runs.laps import laps_of
from analysis.runs.tables import CircleTable
from analysis.runs.tabular import Tabular
from rigs.schema.vocabulary import Direction, TestName
from rigs.text import counted


@dataclass(frozen=True)
class ResidualPlace:
    """A place of disagreement between measurement and simulation beyond noise and scatter between runs.

    `part` is `distance` (mean of the gauges) or `angle` (their difference over the baseline). `from_deg` and `to_deg`
    are circle angles, or the numbers of the first and last target for tests at targets. `joint` is the joint that
    reverses there, if any. `rms_um` is the rms of the residual there, and `sigma` the ratio of the largest value to
    noise and scatter.
    """

    test: TestName
    direction: Direction | None
    part: Literal["distance", "angle"]
    from_deg: float
    to_deg: float
    joint: int | None
    why: str
    rms_um: float
    sigma: float

    def to_dict(self) -> dict[str, Any]:
        """Return plain types."""
        return {"channel": self.test, **{key: value for key, value in asdict(self).items() if key != "test"}}


@dataclass(frozen=True)
class ResidualBand:
    """The unexplained residual in a band of orders (cycles per lap), or at targets: ratio of chi-square to the
    expectation from noise, and description.
    """

    test: TestName
    direction: Direction | None
    part: Literal["distance", "angle", "targets"]
    orders: tuple[int, int] | None
    ratio: float
    words: str


@dataclass(frozen=True)
class Curve(Tabular):
    """Residuals (n, 2) µm of the two gauges of a circle at the circle angles phi_deg (n,), averaged over the runs
    with the set-up fitted. `turns` lists (circle angle in degrees, joint) of joint reversals.
    """

    test: TestName
    direction: Direction
    phi_deg: Array
    before_um: Array
    after_um: Array
    turns: tuple[tuple[float, int], ...]

    def to_table(self) -> pa.Table:
        """Return a row for each circle angle: phi_deg, and before and after of each gauge, as g1_before_um."""
        both = {"before": self.before_um, "after": self.after_um}
        gauges = {f"g{k + 1}_{when}_um": values[:, k] for when, values in both.items() for k in range(values.shape[1])}
        return pa.table({"phi_deg": self.phi_deg} | gauges)


@dataclass(frozen=True)
class Map(Tabular):
    """Residuals (n,) µm at targets, with number, polar angle and azimuth (n,) in degrees. For poses, the residual is
    the remaining distance (n,), and the numbers are row numbers.
    """

    test: TestName
    target: Array
    polar_deg: Array
    azimuth_deg: Array
    before_um: Array
    after_um: Array

    def to_table(self) -> pa.Table:
        """Return a row for each reading, with a column for each field except the test."""
        return pa.table({name: values for name, values in vars(self).items() if name != "test"})


# ----------------------------------------------------------------------------------------------------------------------
# The unexplained residual: bands of orders, and targets, with a residual above the noise, and a description.

_REPORTED = 4
"""Number of reported bands. Chosen: more do not help a reader."""
_LEAST = 2.0
"""Ratio of the energy to that of the noise above which a band is reported. Chosen: at 2 the residual beyond the
noise equals the noise.
"""
_CLEAR = 6.0
"""Standard deviations of chi-square by which a band must exceed the noise, so that bands of few readings are not
reported by chance: for bands of five readings, noise exceeds it once in some thousands.
"""
_SLOW = 30
"""Orders below this limit are compared between the directions. Chosen: as for the level of slow noise in `noise`."""


Part = Literal["distance", "angle"]
_PARTS: tuple[tuple[Part, slice], ...] = (
    ("distance", slice(0, len(ORDER_OF) // 2)),
    ("angle", slice(len(ORDER_OF) // 2, len(ORDER_OF))),
)
"""Entries of a circle that belong to the mean of the gauges, and to their difference."""


def bands_above_noise(blocks: Sequence[Block], residual: Array) -> tuple[ResidualBand, ...]:
    """Return the bands above the noise, largest energy in mm² first, given the `residual` (N,) in standard
    deviations of the noise.
    """
    clear: list[tuple[float, ResidualBand]] = []
    parity, begin = _parity(blocks, residual), 0
    for block in blocks:
        of_block, table = residual[begin : begin + len(block.y_mm)], block.table
        begin += len(of_block)
        bands: list[tuple[Part | Literal["targets"], tuple[int, int] | None, Integers]]
        bands = [("targets", None, np.arange(len(of_block)))]
        if block.sampling:
            entries = [(part, np.arange(len(ORDER_OF))[of_part]) for part, of_part in _PARTS]
            bands = [
                (part, (low, high - 1), of_part[(ORDER_OF[of_part] >= low) & (ORDER_OF[of_part] < high)])
                for part, of_part in entries
                for low, high in pairwise(BAND_EDGES)
            ]
        for part, orders, rows in bands:
            ratio = float(np.mean(of_block[rows] ** 2))
            if ratio <= max(_LEAST, 1 + _CLEAR * np.sqrt(2 / len(rows))):
                continue  # chance explains it
            words = f"{np.sqrt(ratio):.1f} times the noise"
            words = f"{orders[0]} to {orders[1]} waves per lap, {words}" if orders else f"the targets differ by {words}"
            correlation = parity.get((table.test, part), 0.0)
            if abs(correlation) > 0.5:
                words += (
                    ", the same in both directions" if correlation > 0 else ", of opposite sign in the other direction"
                )
            energy_mm2 = float(((of_block[rows] * block.sd_mm[rows]) ** 2).sum())
            clear.append((energy_mm2, ResidualBand(table.test, table.driven_direction, part, orders, ratio, words)))
    clear.sort(key=lambda band: -band[0])
    return tuple(band for _, band in clear[:_REPORTED])


def _parity(blocks: Sequence[Block], residual: Array) -> dict[tuple[TestName, str], float]:
    """Return the correlation of the residual cw and acw at the same circle angles, by test and part."""
    ways: dict[tuple[TestName, Direction], Array] = {}
    begin = 0
    for block in blocks:
        table = block.table
        if direction := table.driven_direction:
            ways[table.test, direction] = residual[begin : begin + len(ORDER_OF)]
        begin += len(block.y_mm)
    correlations: dict[tuple[TestName, str], float] = {}
    for test in {test for test, _ in ways}:
        cw, acw = ways.get((test, "cw")), ways.get((test, "acw"))
        if cw is not None and acw is not None:
            for part, entries in _PARTS:
                slow = ORDER_OF[entries] < _SLOW
                correlations[test, part] = float(np.corrcoef(cw[entries][slow], acw[entries][slow])[0, 1])
    return correlations


# ----------------------------------------------------------------------------------------------------------------------
# Places of disagreement between measurement and simulation: stretches of a circle, or targets, with a residual above
# the noise.
#
# A residual that is too small to be detected at any single place may still be detected by its form over the complete
# lap, which the search uses.

_SMOOTH = 60
"""Orders above this are too fine for a place. Chosen: a wave of order 60 spans 6 degrees of the circle."""
_SIGMA = 4.0
"""Sigmas above which a residual is reported: with 512 correlated values, noise alone rarely exceeds 4 sigma."""
_GAP = GRID // 60
"""Largest gap in grid steps between two stretches that are reported together: 6 degrees, the resolution of the
smoothed residual.
"""
_NEAR_DEG = 4.0
"""Distance from a reversal within which a stretch or jump is attributed to it. Chosen: backlash is crossed within
some degrees.
"""
_UNUSUAL = 5.0
"""Ratio to the median change over the same distance above which a change is a jump. Chosen: the largest change of a
wave is 1.4 times its median change."""
_MOST = 50
"""Number of reported places. Chosen: pictures shade all places of most cells; lists stop at the worst."""


def places(blocks: Sequence[Block], left_mm: Sequence[Array], scatter_mm: Sequence[Array]) -> tuple[ResidualPlace, ...]:
    """Return the worst places, largest sigma first.

    left_mm: residual of each block as entries (N,) mm. scatter_mm: contribution of a standard deviation of all scatter
    between runs, (N, c) mm.
    """
    all_places: list[ResidualPlace] = []
    for block, residual, scattered in zip(blocks, left_mm, scatter_mm, strict=True):
        all_places += (_on_circle if block.sampling else _at_targets)(block, residual, scattered)
    return tuple(sorted(all_places, key=lambda place: -place.sigma)[:_MOST])


def reversals_of(block: Block) -> tuple[tuple[float, int], ...]:
    """Return the circle angles in degrees at which joints reverse, each with its joint."""
    table = block.table
    if not isinstance(table, CircleTable):
        return ()
    lap = laps_of(table, block.model.rig, block.name)
    return tuple((float(np.degrees(turn.phi)), turn.axis) for turn in turns(lap))


def _on_circle(block: Block, residual: Array, scatter_mm: Array) -> list[ResidualPlace]:
    table = block.table
    direction = table.driven_direction
    drawn = np.column_stack([residual, scatter_mm])[: len(ORDER_OF)] * (ORDER_OF <= _SMOOTH)[:, None]
    curves = [curve(column) for column in drawn.T]
    offsets = np.array([gauge.offset_mm for _, gauge in block.model.rig.gauges])
    where = reversals_of(block)
    places_there = []
    for part, entries in _PARTS:
        values, *others = (
            gauges.mean(axis=1) if part == "distance" else gauges[:, 1] - gauges[:, 0] for gauges in curves
        )
        scattered = np.reshape(others, (-1, GRID))
        # Sum and difference are unitary: the noise of the gauge mean is 1/√2 of that of the sum, the noise of the gauge
        # difference √2 of that of the unitary difference.
        scale = np.sqrt(0.5) if part == "distance" else np.sqrt(2)
        kept = ORDER_OF[entries] <= _SMOOTH
        alike = scale * float(np.sqrt((block.sd_mm[entries][kept] ** 2).sum() / GRID))
        noise = np.sqrt(alike**2 + (scattered**2).sum(axis=0))
        for begin, end in _stretches(np.abs(values) > _SIGMA * noise):
            rows = np.arange(begin, end) % GRID
            rms = float(np.sqrt(np.mean(values[rows] ** 2)))
            sigma = float((np.abs(values[rows]) / noise[rows]).max())
            a, b = 360 * begin / GRID, 360 * (end - 1) / GRID
            joint, why = _why(where, values, a, b)
            span = float(np.ptp(offsets)) or 1.0
            if part == "angle" and joint is None and b - a > 300:
                why += f" (± {np.degrees(np.abs(values).max() / span):.4f}°)"
            places_there.append(
                ResidualPlace(table.test, direction, part, a % 360, b % 360, joint, why, 1e3 * rms, sigma)
            )
        for phi, joint, jump, sigma in _jumps(values, where, alike, scattered):
            why = f"step of {1e3 * jump:.1f} µm at a reversal"
            low, high = (phi - _NEAR_DEG) % 360, (phi + _NEAR_DEG) % 360
            places_there.append(
                ResidualPlace(table.test, direction, part, low, high, joint, why, 1e3 * jump / 2, sigma)
            )
    return places_there


def _jumps(
    values: Array, where: Sequence[tuple[float, int]], alike: float, scattered: Array
) -> list[tuple[float, int, float, float]]:
    """Return the reversals with a jump of the residual (GRID,) larger than elsewhere: circle angle in degrees, joint,
    size of the jump, and sigma.

    alike: uniform noise. scattered (c, GRID): contribution of a standard deviation of scatter.
    """
    step = max(1, round(_NEAR_DEG / 360 * GRID))
    over, apart = (np.roll(of, -step, axis=-1) - np.roll(of, step, axis=-1) for of in (values, scattered))
    over = np.abs(over)
    sigmas = over / np.sqrt(2 * alike**2 + (apart**2).sum(axis=0))
    usual = float(np.median(over))
    jumps = []
    for phi, joint in where:
        near = (round(phi / 360 * GRID) + np.arange(-step, step + 1)) % GRID
        largest = near[int(np.argmax(over[near]))]
        jump, sigma = float(over[largest]), float(sigmas[largest])
        if jump > _UNUSUAL * usual and sigma > _SIGMA:
            jumps.append((phi, joint, jump, sigma))
    return jumps


def _stretches(over: Array) -> list[tuple[int, int]]:
    """Return the first and last index of each stretch on the closed circle. Small gaps are bridged, and an end may
    exceed the end of the lap.
    """
    if over.all():
        return [(0, GRID)]
    start = int(np.argmin(over))
    flags = np.roll(over, -start)
    runs: list[list[int]] = []
    for k in np.flatnonzero(flags):
        if runs and k - runs[-1][1] <= _GAP:
            runs[-1][1] = int(k) + 1
        else:
            runs.append([int(k), int(k) + 1])
    return [(begin + start, end + start) for begin, end in runs if end - begin > 1]


def _why(where: Sequence[tuple[float, int]], values: Array, begin_deg: float, end_deg: float) -> tuple[int | None, str]:
    """Return the joint that reverses in a stretch, if the stretch is short enough for a single reversal, and a
    description of the residual (GRID,).
    """
    if end_deg - begin_deg <= 90:
        middle, reach = (begin_deg + end_deg) / 2, (end_deg - begin_deg) / 2 + _NEAR_DEG
        near = [(abs((phi - middle + 180) % 360 - 180), joint) for phi, joint in where]
        distance, joint = min(near, default=(np.inf, 0))
        if distance <= reach:
            return joint, "reversal"
    power = np.abs(np.fft.rfft(values)) ** 2
    order = int(np.argmax(power))
    if power[order] > 0.5 * power.sum():
        return None, "constant over the lap" if order == 0 else f"{counted(order, 'wave')} per lap"
    return None, "over the whole circle" if end_deg - begin_deg > 300 else "part of the circle"


def _at_targets(block: Block, residual: Array, scatter_mm: Array) -> list[ResidualPlace]:
    table, coordinates = block.table, 3 if facts_of(block.table.test).of_places else 1
    variance = block.sd_mm**2 + (scatter_mm**2).sum(axis=1)
    size, noise = (np.sqrt(square.reshape(-1, coordinates).sum(axis=1)) for square in (residual**2, variance))
    number = table.numbers[block.rows]
    over = size > _SIGMA * noise
    if not over.any():
        return []
    rows, worst = labels_of(table.test).rows, number[int(np.argmax(size))]
    why = f"{over.sum()} of {len(size)} {rows} differ, most at number {worst}"
    low, high = float(number[over].min()), float(number[over].max())
    rms_um, sigma = 1e3 * float(np.sqrt(np.mean(size[over] ** 2))), float((size / noise).max())
    return [ResidualPlace(table.test, None, "distance", low, high, None, why, rms_um, sigma)]


# ----------------------------------------------------------------------------------------------------------------------
# Residuals of a model, with set-ups fitted, in the form that plots show: curves of circles and maps of targets.


def curves_of(blocks: Sequence[Block], before: Sequence[Array], after: Sequence[Array]) -> tuple[Curve, ...]:
    """Return the curves of the blocks of circles, given the residual (N,) mm of each block before and after."""
    curves, phi = [], np.arange(GRID) * 360 / GRID
    for block, was, now in zip(blocks, before, after, strict=True):
        table = block.table
        if block.sampling and (direction := table.driven_direction):
            gauges = 1e3 * curve(was), 1e3 * curve(now)
            curves.append(Curve(table.test, direction, phi, *gauges, reversals_of(block)))
    return tuple(curves)


def maps_of(blocks: Sequence[Block], before: Sequence[Array], after: Sequence[Array]) -> tuple[Map, ...]:
    """Return the maps of the blocks of targets and poses, given the residual (N,) mm of each block before and after."""
    maps = []
    for block, *values in zip(blocks, before, after, strict=True):
        table, rows = block.table, block.rows
        if not block.sampling:
            sizes = [1e3 * np.linalg.norm(value.reshape(len(rows), -1), axis=1) for value in values]
            polar, azimuth = (
                np.degrees(angles)[rows] for angles in kind_of(table.test).angles_of(table, block.model.rig)
            )
            maps.append(Map(table.test, table.numbers[rows].astype(float), polar, azimuth, *sizes))
    return tuple(maps)
