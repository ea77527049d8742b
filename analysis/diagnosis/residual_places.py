"""The places where measurement and simulation disagree: stretches of a circle, or targets, where the residual exceeds
its noise.

A residual that is too small to be detected at any single place may still be detected by its form over the whole lap,
which the search uses.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.diagnosis.blocks import Block
from analysis.diagnosis.diagnosis import Place
from analysis.diagnosis.observed_run import GRID, ORDER_OF, curve
from analysis.kinematics.arm import Array
from analysis.measures.joint_reversals import turns
from analysis.traces.laps import laps_of
from analysis.traces.tables import CircleTable, PoseTable, test_of

_SMOOTH = 60
"""Orders above this are too fine for a place. Chosen: a wave of order 60 spans 6 degrees of the circle."""
_SIGMA = 4.0
"""Sigmas above which a residual is reported: with 512 correlated values, noise alone rarely exceeds 4 sigma."""
_GAP = GRID // 60
"""Steps of the grid between two stretches that are reported as one: 6 degrees, the resolution of the smoothed residual.
"""
_NEAR_DEG = 4.0
"""Distance from a reversal within which a stretch or jump is attributed to it. Chosen: a play is crossed within some
degrees."""
_UNUSUAL = 5.0
"""Ratio to the median change over the same distance above which a change is a jump. Chosen: the largest change of a
wave is 1.4 times its median change."""
_MOST = 10
"""Number of places that are reported. Chosen: more do not help a reader."""


def places(blocks: Sequence[Block], left_mm: Sequence[Array]) -> tuple[Place, ...]:
    """Return the worst places, the largest sigma first, given the residual of each block as its entries (N,) mm."""
    found: list[Place] = []
    for block, left in zip(blocks, left_mm, strict=True):
        found += _on_circle(block, left) if block.sampling else _at_targets(block, left)
    return tuple(sorted(found, key=lambda place: -place.sigma)[:_MOST])


def reversals_of(block: Block) -> tuple[tuple[float, int], ...]:
    """Return the circle angles in degrees at which joints reverse, each with its joint."""
    if not isinstance(block.one.table, CircleTable):
        return ()
    lap = laps_of(block.one.table, block.model.rig, block.name)
    return tuple((float(np.degrees(turn.phi)), turn.axis) for turn in turns(lap))


def _on_circle(block: Block, left: Array) -> list[Place]:
    table = block.one.table
    assert isinstance(table, CircleTable)  # noqa: S101 - blocks with a sampling are circles
    half = len(ORDER_OF) // 2
    smooth = np.where(ORDER_OF <= _SMOOTH, left[: 2 * half], 0.0)
    readings = curve(smooth)
    stamps = [curve(np.where(ORDER_OF <= _SMOOTH, one, 0.0)) for one in block.stamps_mm[: 2 * half].T]
    offsets = np.array([gauge.offset_mm for _, gauge in block.model.rig.gauges])
    where = reversals_of(block)
    found = []
    for part, of, entries in (("distance", _distance, slice(0, half)), ("angle", _angle, slice(half, 2 * half))):
        values = of(readings)
        # Sum and difference are unitary: the mean of the gauges has 1/sqrt 2 of the sum's noise, their difference
        # sqrt 2 of its own.
        scale = np.sqrt(0.5) if part == "distance" else np.sqrt(2)
        kept = ORDER_OF[entries] <= _SMOOTH
        alike = scale * float(np.sqrt((block.sd_mm[entries][kept] ** 2).sum() / GRID))
        noise = np.sqrt(alike**2 + sum((of(one) ** 2 for one in stamps), np.zeros(GRID)))
        for begin, end in _stretches(np.abs(values) > _SIGMA * noise):
            rows = np.arange(begin, end) % GRID
            rms = float(np.sqrt(np.mean(values[rows] ** 2)))
            sigma = float((np.abs(values[rows]) / noise[rows]).max())
            a, b = 360 * begin / GRID, 360 * (end - 1) / GRID
            joint = _turning(where, a, b)
            why = _why(joint, values, a, b)
            span = float(np.ptp(offsets)) or 1.0
            if part == "angle" and joint is None and b - a > 300:
                why += f" (± {np.degrees(np.abs(values).max() / span):.4f}°)"
            found.append(
                Place(table.test, table.direction, part, a % 360, b % 360, joint, why, 1e3 * rms, sigma)  # type: ignore[arg-type]
            )
        for phi, joint, jump, sigma in _jumps(values, where, noise):
            why = f"reversal: jumps by {1e3 * jump:.1f} µm"
            low, high = (phi - _NEAR_DEG) % 360, (phi + _NEAR_DEG) % 360
            found.append(
                Place(table.test, table.direction, part, low, high, joint, why, 1e3 * jump / 2, sigma)  # type: ignore[arg-type]
            )
    return found


def _distance(readings: Array) -> Array:
    """Return the mean (GRID,) of two gauges (GRID, 2)."""
    mean: Array = readings.mean(axis=1)
    return mean


def _angle(readings: Array) -> Array:
    """Return the difference (GRID,) of two gauges (GRID, 2)."""
    difference: Array = readings[:, 1] - readings[:, 0]
    return difference


def _jumps(values: Array, where: Sequence[tuple[float, int]], noise: Array) -> list[tuple[float, int, float, float]]:
    """Return the reversals at which the residual (GRID,) jumps more than elsewhere, given its noise (GRID,): circle
    angle in degrees, joint, size of the jump, and sigma."""
    step = max(1, round(_NEAR_DEG / 360 * GRID))
    over = np.abs(np.roll(values, -step) - np.roll(values, step))
    sigmas = over / np.hypot(np.roll(noise, -step), np.roll(noise, step))
    usual = float(np.median(over))
    found = []
    for phi, joint in where:
        near = (round(phi / 360 * GRID) + np.arange(-step, step + 1)) % GRID
        largest = near[int(np.argmax(over[near]))]
        jump, sigma = float(over[largest]), float(sigmas[largest])
        if jump > _UNUSUAL * usual and sigma > _SIGMA:
            found.append((phi, joint, jump, sigma))
    return found


def _stretches(over: Array) -> list[tuple[int, int]]:
    """Return the first and last index of each stretch on the closed circle. Small gaps are bridged, and an end may lie
    beyond the end of the lap."""
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


def _turning(where: Sequence[tuple[float, int]], begin_deg: float, end_deg: float) -> int | None:
    """Return the joint that reverses in a stretch, if the stretch is short enough to belong to one reversal."""
    if end_deg - begin_deg > 90:
        return None
    middle, reach = (begin_deg + end_deg) / 2, (end_deg - begin_deg) / 2 + _NEAR_DEG
    near = [(abs((phi - middle + 180) % 360 - 180), joint) for phi, joint in where]
    best = min(near, default=(np.inf, 0))
    return best[1] if best[0] <= reach else None


def _why(joint: int | None, values: Array, begin_deg: float, end_deg: float) -> str:
    if joint is not None:
        return "reversal"
    power = np.abs(np.fft.rfft(values)) ** 2
    order = int(np.argmax(power))
    if power[order] > 0.5 * power.sum():
        return "all along, constant" if order == 0 else f"wave of {order} cycle{'s' * (order > 1)} a lap"
    return "all along the circle" if end_deg - begin_deg > 300 else "stretch"


def _at_targets(block: Block, left: Array) -> list[Place]:
    table = block.one.table
    if isinstance(table, PoseTable):
        size = np.sqrt((left.reshape(-1, 3) ** 2).sum(axis=1))
        noise, number = block.sd_mm.reshape(-1, 3).mean(axis=1) * np.sqrt(3), block.one.rows + 1
        what = "poses"
    else:
        assert not isinstance(table, CircleTable)  # noqa: S101 - circles have a sampling
        size, noise, number = np.abs(left), block.sd_mm, table.target
        what = "targets"
    over = size > _SIGMA * noise
    if not over.any():
        return []
    why = f"{over.sum()} of {len(size)} {what}, worst {number[int(np.argmax(size))]}"
    return [
        Place(
            test_of(table),
            None,
            "distance",
            float(number[over].min()),
            float(number[over].max()),
            None,
            why,
            1e3 * float(np.sqrt(np.mean(size[over] ** 2))),
            float((size / noise).max()),
        )
    ]
