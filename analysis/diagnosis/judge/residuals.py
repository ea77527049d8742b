"""The residual: the part of the readings that the model does not explain, in figures, places, bands and curves."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
import pyarrow as pa

from analysis.diagnosis.evidence.blocks import BAND_EDGES, Block
from analysis.diagnosis.evidence.observation import GRID, ORDER_OF, curve
from analysis.procedures.shared.joint_reversals import turns
from analysis.procedures.shared.test_kind import kind_of, labels_of
from analysis.robot.kinematics.arm import Array, Integers
from analysis.runs.laps import laps_of
from analysis.runs.tables import CircleTable
from analysis.runs.tabular import Tabular
from rigs.schema.vocabulary import Direction, TestName
from rigs.text import counted

Subject = Literal["angle", "load", "posture", "approach", "speed", "time", "temperature", "place"]
"""Possible dependence of a residual: angle of a joint, torque of gravity, joint angles together, approach side, speed
of a joint, and others.
"""
FOLLOWED = 0.2
"""Share from which a residual is said to depend on a quantity. Chosen: the best of twenty quantities explains up to a
tenth of plain noise.
"""


@dataclass(frozen=True)
class Dependence:
    """A quantity and the share of the mean square that it explains at places not used to fit it."""

    what: Subject
    share: float
    axis: int | None = None
    """The joint; None for a quantity of the whole arm."""


@dataclass(frozen=True)
class HeldOutResidual:
    """Residual of each neighbourhood of positions for a model fitted to all others."""

    um: float
    """Rms distance."""
    noise_um: float
    """Noise of a position, rms distance."""
    looked: Mapping[Subject, float | None]
    """Share that each quantity of the whole arm explains; None if the runs do not contain it."""

    def to_dict(self) -> dict[str, Any]:
        looked = [{"subject": subject, "share": share} for subject, share in self.looked.items()]
        return {"um": self.um, "noise_um": self.noise_um, "looked": looked}


@dataclass(frozen=True)
class Residual:
    """Part of the readings, beyond the noise, that neither the named effects nor the usual errors of a healthy arm
    explain."""

    um: float
    """Rms, including the contribution of contradicted effects; at most that of the initial model."""
    share: float = 0.0
    """Share of the squared residual of the initial model."""
    words: str = ""
    """Description of the pattern."""
    healthy_um: float = 0.0
    """Rms of the usual errors of a healthy arm."""
    at_new_places: bool = False
    """True if `um` is the error at places not used in the fit, because it is larger there."""
    is_material: bool = False
    """True if it exceeds the scatter of a run."""
    follows: tuple[Dependence, ...] = ()
    """Quantities on which the residual of an unknown cause depends, the likeliest first."""
    scatter_um: float | None = None
    """Scatter of a coordinate of poses if the residual is scatter and every target was visited once."""
    visits_um: float | None = None
    """Rms distance between a visit of a target and the mean of its visits, or between a circle and the mean of its
    repeats, if it exceeds the usual repeatability of the build."""
    unrepeated_um: float | None = None
    """Rms deviation of targets visited once from the calibrated model, if it is larger than usual scatter: scatter or
    an unknown cause."""
    gauges_um: float | None = None
    """Rms change of the difference of two gauges between repeated circles, if movements of the tool are smaller."""
    held_out: HeldOutResidual | None = None
    """None if no positions were measured."""

    @property
    def likeliest(self) -> Dependence | None:
        return next((each for each in self.follows if each.share >= FOLLOWED), None)

    def to_dict(self) -> dict[str, Any]:
        """Plain types, with the keys `remainder`, `unexplained` and `remains` of a diagnosis."""
        whole = asdict(self)
        remainder = {key: whole[key] for key in ("um", "share", "words", "healthy_um", "at_new_places", "is_material")}
        causes = {key: whole[key] for key in ("follows", "scatter_um", "visits_um", "unrepeated_um", "gauges_um")}
        remains = {"remains": self.held_out.to_dict()} if self.held_out else {}
        return {"remainder": remainder, "unexplained": {"rms_um": self.um, **causes}, **remains}


def independent_um(um: float, part_um: float) -> float:
    return math.sqrt(max(um**2 - part_um**2, 0.0))


@dataclass(frozen=True)
class ResidualPlace:
    """A place with a residual beyond noise and scatter between runs.

    `part` is `distance` (mean of the gauges) or `angle` (their difference over the baseline). `from_deg` and `to_deg`
    are circle angles, or the numbers of the first and last target. `joint`: that reverses there. `sigma`: ratio of the
    largest value to noise and scatter.
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
        return {"channel": self.test, **{key: value for key, value in asdict(self).items() if key != "test"}}


@dataclass(frozen=True)
class ResidualBand:
    """The residual in a band of orders (cycles per lap), or at targets: ratio of chi-square to the expectation from
    noise.
    """

    test: TestName
    direction: Direction | None
    part: Literal["distance", "angle", "targets"]
    orders: tuple[int, int] | None
    ratio: float
    words: str


@dataclass(frozen=True)
class Curve(Tabular):
    """Residuals (n, 2) µm of the two gauges of a circle at the circle angles phi_deg (n,), averaged over the runs with
    the set-up fitted. `turns`: (circle angle in degrees, joint) of reversals.
    """

    test: TestName
    direction: Direction
    phi_deg: Array
    before_um: Array
    after_um: Array
    turns: tuple[tuple[float, int], ...]

    def to_table(self) -> pa.Table:
        """A row for each circle angle: phi_deg, and before and after of each gauge, as g1_before_um."""
        both = {"before": self.before_um, "after": self.after_um}
        gauges = {f"g{k + 1}_{when}_um": values[:, k] for when, values in both.items() for k in range(values.shape[1])}
        return pa.table({"phi_deg": self.phi_deg} | gauges)


@dataclass(frozen=True)
class Map(Tabular):
    """Residuals (n,) µm at targets, with number, polar angle and azimuth in degrees; for poses the distance and the row
    number.
    """

    test: TestName
    target: Array
    polar_deg: Array
    azimuth_deg: Array
    before_um: Array
    after_um: Array

    def to_table(self) -> pa.Table:
        return pa.table({name: values for name, values in vars(self).items() if name != "test"})


# ----------------------------------------------------------------------------------------------------------------------
# Bands of orders, and targets, with a residual above the noise.

_REPORTED = 4
"""Number of reported bands. Chosen: more do not help a reader."""
_CLEAR = 6.0
"""Standard deviations of chi-square by which a band must exceed the noise: noise does once in some thousands."""


Part = Literal["distance", "angle"]
_PARTS: tuple[tuple[Part, slice], ...] = (
    ("distance", slice(0, len(ORDER_OF) // 2)),
    ("angle", slice(len(ORDER_OF) // 2, len(ORDER_OF))),
)
"""Entries of a circle that belong to the mean of the gauges, and to their difference."""


def bands_above_noise(blocks: Sequence[Block], residual: Array) -> tuple[ResidualBand, ...]:
    """The bands above the noise, largest energy first, given the `residual` (N,) in noise standard deviations."""
    clear: list[tuple[float, ResidualBand]] = []
    begin = 0
    for block in blocks:
        of_block = residual[begin : begin + len(block.y_mm)]
        begin += len(of_block)
        for part, orders, rows in _bands_of(block):
            ratio = float(np.mean(of_block[rows] ** 2))
            if ratio > 1 + _CLEAR * np.sqrt(2 / len(rows)):
                words = f"{np.sqrt(ratio):.1f} times the noise"
                words = (
                    f"{orders[0]} to {orders[1]} waves per lap, {words}" if orders else f"the targets differ by {words}"
                )
                energy_mm2 = float(((of_block[rows] * block.sd_mm[rows]) ** 2).sum())
                table = block.table
                clear.append((energy_mm2, ResidualBand(table.test, table.driven_direction, part, orders, ratio, words)))
    clear.sort(key=lambda band: -band[0])
    return tuple(band for _, band in clear[:_REPORTED])


def _bands_of(block: Block) -> list[tuple[Part | Literal["targets"], tuple[int, int] | None, Integers]]:
    """Bands of a block: part, orders, and entries (n,)."""
    if block.sampling is None:
        return [("targets", None, np.arange(len(block.y_mm)))]
    return [
        (part, (low, high - 1), of_part.start + np.flatnonzero((ORDER_OF[of_part] >= low) & (ORDER_OF[of_part] < high)))
        for part, of_part in _PARTS
        for low, high in pairwise(BAND_EDGES)
    ]


# ----------------------------------------------------------------------------------------------------------------------
# Places: stretches of a circle, or targets, with a residual above the noise.
#
# A residual that is too small to be detected at any single place may still be detected by its form over the complete
# lap, which the search uses.

_SMOOTH = 60
"""Orders above this are too fine for a place. Chosen: a wave of order 60 spans 6 degrees of the circle."""
_SIGMA = 4.0
"""Sigmas above which a residual is reported: noise alone rarely exceeds 4 sigma in 512 correlated values."""
_GAP = GRID // 60
"""Largest gap in grid steps between two stretches that are reported together: the resolution of the smoothed
residual.
"""
_NEAR_DEG = 4.0
"""Distance from a reversal within which a stretch or jump is attributed to it. Chosen: backlash is crossed within some
degrees.
"""
_UNUSUAL = 5.0
"""Ratio to the median change over the same distance above which a change is a jump. Chosen: a wave has 1.4."""
_MOST = 50
"""Number of reported places. Chosen: pictures shade all places of most cells."""


def places(
    blocks: Sequence[Block], residual_mm: Sequence[Array], scatter_mm: Sequence[Array]
) -> tuple[ResidualPlace, ...]:
    """The worst places, largest sigma first. residual_mm: residual of each block as entries (N,) mm. scatter_mm (N, c):
    contribution of a standard deviation of all scatter between runs.
    """
    all_places: list[ResidualPlace] = []
    for block, residual, scattered in zip(blocks, residual_mm, scatter_mm, strict=True):
        all_places += (_on_circle if block.sampling else _at_targets)(block, residual, scattered)
    return tuple(sorted(all_places, key=lambda place: -place.sigma)[:_MOST])


def reversals_of(block: Block) -> tuple[tuple[float, int], ...]:
    """Circle angles in degrees at which joints reverse, each with its joint."""
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
    """Reversals with a jump of the residual (GRID,) larger than elsewhere: circle angle in degrees, joint, size of the
    jump, and sigma. alike: uniform noise. scattered (c, GRID): contribution of a standard deviation of scatter.
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
    """First and last index of each stretch on the closed circle, with small gaps bridged; an end may exceed the lap."""
    start = int(np.argmin(over))
    flagged = np.flatnonzero(np.roll(over, -start))
    stretches = np.split(flagged, np.flatnonzero(np.diff(flagged) > _GAP + 1) + 1)
    return [(int(at[0]) + start, int(at[-1]) + 1 + start) for at in stretches if len(at) > 1]


def _why(where: Sequence[tuple[float, int]], values: Array, begin_deg: float, end_deg: float) -> tuple[int | None, str]:
    """The joint that reverses in a stretch, if short enough for a single reversal, and a description of the residual
    (GRID,).
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
    table, coordinates = block.table, 3 if block.facts.of_places else 1
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
    curves, phi = [], np.arange(GRID) * 360 / GRID
    for block, was, now in zip(blocks, before, after, strict=True):
        table = block.table
        if block.sampling and (direction := table.driven_direction):
            gauges = 1e3 * curve(was), 1e3 * curve(now)
            curves.append(Curve(table.test, direction, phi, *gauges, reversals_of(block)))
    return tuple(curves)


def maps_of(blocks: Sequence[Block], before: Sequence[Array], after: Sequence[Array]) -> tuple[Map, ...]:
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


# ----------------------------------------------------------------------------------------------------------------------
# Staircase: the residual as parts of the error are added to the model one after the other.


@dataclass(frozen=True)
class ModelResidual:
    """Residual of a model at a place, root mean square in µm, with standard uncertainty."""

    um: float
    u_um: float


@dataclass(frozen=True)
class StaircaseStep:
    """A model of the staircase. `parts`: indices of the parts added in this step, in the budget of a diagnosis or among
    the effects of a rig file. The residuals refer to the runs used, held out, and at an unseen place.
    """

    parts: tuple[int, ...]
    used: ModelResidual
    held_out: ModelResidual | None = None
    unseen: ModelResidual | None = None

    def to_dict(self) -> dict[str, Any]:
        at_places = {"used": self.used, "held_out": self.held_out, "unseen_place": self.unseen}
        return {
            "parts": self.parts,
            "left": {place: left_there and asdict(left_there) for place, left_there in at_places.items()},
        }


@dataclass(frozen=True)
class Staircase:
    """The steps from the initial to the calibrated model. `curves`: residuals (steps, n, 2) µm of each circle; `maps`:
    (steps, n) µm at targets; all with fitted set-ups.
    """

    steps: tuple[StaircaseStep, ...]
    curves: tuple[Array, ...] = ()
    maps: tuple[Array, ...] = ()

    @property
    def places(self) -> tuple[str, ...]:
        return tuple(place for place in ("used", "held_out", "unseen") if getattr(self.steps[0], place) is not None)

    def to_dict(self, names: Sequence[str]) -> list[dict[str, Any]]:
        return [{**step.to_dict(), "parts": [names[k] for k in step.parts]} for step in self.steps]
