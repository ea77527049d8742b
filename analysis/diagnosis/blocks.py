"""Repeated runs as one block of readings with the noise of their mean: what the search for names works on.

Neighbouring readings on a circle are correlated, so circles are taken apart into orders (cycles a lap) of the sum and
of the difference of the gauges; `noise` says how noisy each is. Readings at targets are taken as they are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnosis.noise import POSE_MM, CircleNoise, Repeated, circle_noise, shaken_by, target_sd
from analysis.diagnosis.observed import ORDER_OF, ORDERS, Sampling, Seen
from analysis.diagnosis.settle import grown
from analysis.fitting.observation import Observation, residuals_of
from analysis.kinematics.arm import Array, Integers
from analysis.measures.pose import groups as visits
from analysis.model.predict import Model, SetUp
from analysis.traces.tables import PoseTable, RadialTable, RepeatabilityTable
from rigs.effects import Effect

EDGES = (0, 3, 8, 16, 30, 60, 120, ORDERS)
"""Edges of the bands of orders, within which what no effect explains may have a strength of its own."""
_SLOW = 8
"""Orders below this are as slow as a robot that stands."""
_SAME_RAD = 3e-4
"""Joints that differ by less, each, are the same: controllers report them in steps of a third of that."""


@dataclass(frozen=True)
class Block:
    """Repeated runs of one test and direction.

    model: of their rig file; one: the first of them, whose feedback stands for all; y_mm (N,): their weighted mean
    residual; sd_mm (N,) of it, scatter aside; scatter_mm (N, c): what one standard deviation of the scatter of joints
    and ball adds to it; band (N,): of which entries share a strength; count of runs; measured: whether the noise is
    from repeats; places: what runs that repeat these share.
    """

    name: str
    model: Model
    one: Observation
    sampling: Sampling | None
    y_mm: Array
    sd_mm: Array
    scatter_mm: Array
    band: Integers
    count: int
    measured: bool
    places: bytes

    def whitened(self, values: Array) -> Array:
        """Readings (m, k, …) mm in standard deviations of the noise: (N, …)."""
        return self.white(entries(values, self.sampling))

    def white(self, vector: Array) -> Array:
        """Entries (N, …) mm in standard deviations."""
        return vector / self.sd_mm.reshape(-1, *[1] * (vector.ndim - 1))


def entries(values: Array, sampling: Sampling | None) -> Array:
    """Readings (m, k, …) mm as a block has them, (N, …) mm: a circle's by orders, others as they are."""
    return sampling.vector(values) if sampling else values.reshape(-1, *values.shape[2:])


def blocks_of(runs: Sequence[Seen], setups: Mapping[str, SetUp], known: Sequence[Effect] = ()) -> list[Block]:
    """Blocks of all runs about fitted set-ups; their residuals have no part of known effects any more."""
    groups: dict[tuple[str, bytes], list[Seen]] = {}
    for run in runs:
        groups.setdefault((run.name, places_of(run)), []).append(run)
    gathered = [_gathered(name, members, setups, known) for (name, _), members in groups.items()]
    circles = [raw for raw in gathered if raw.first.sampling]
    grids = [raw.first.sampling.averaged for raw in circles if raw.first.sampling]
    orders = len(ORDER_OF)
    repeats = [
        Repeated(raw.first.one.setup, raw.rows[:, :orders], raw.shaken[:orders], len(raw.first.sampling.share))
        for raw in circles
        if raw.first.sampling
    ]
    noise = circle_noise(repeats, float(np.mean(grids)) if grids else 1.0)
    sds = dict(zip([raw.name for raw in circles], noise.sd_mm, strict=True))  # a circle's name is its own
    numbers = {name: k for k, name in enumerate(dict.fromkeys(raw.first.one.setup for raw in gathered))}
    return [
        _circle_block(raw, sds[raw.name], noise, numbers[raw.first.one.setup])
        if raw.first.sampling
        else _target_block(raw, noise, numbers[raw.first.one.setup])
        for raw in gathered
    ]


def places_of(run: Seen) -> bytes:
    """What must be equal for two runs to repeat each other reading by reading; circles do by their name."""
    if run.sampling:
        return b""
    return _keys(run.one).tobytes()


@dataclass(frozen=True)
class _Raw:
    """Residuals (n, N) mm of the runs of a block, and how unit scatter shows in them (N, c) mm."""

    name: str
    first: Seen
    rows: Array
    shaken: Array


def _gathered(name: str, members: Sequence[Seen], setups: Mapping[str, SetUp], known: Sequence[Effect]) -> _Raw:
    # Where one run did not stand before and after, none is compared by it.
    if not all(run.sampling and run.sampling.stands for run in members):
        members = [replace(run, sampling=run.sampling and run.sampling.without_stands()) for run in members]
    vectors = [entries(residuals_of(run.model, [run.one], setups)[0], run.sampling) for run in grown(members, known)]
    first = members[0]
    shaken = shaken_by(first.model, first.one, setups[first.one.setup])
    # Only repeats of the same targets can be averaged.
    alike = [vector for vector in vectors if len(vector) == len(vectors[0])]
    return _Raw(name, first, np.array(alike), entries(shaken, first.sampling))


def _circle_block(raw: _Raw, sd_mm: Array, noise: CircleNoise, number: int) -> Block:
    sampling = raw.first.sampling
    assert sampling is not None  # noqa: S101 - circles have one
    weight = 1 / (sd_mm[:, EDGES[4] > ORDER_OF] ** 2).mean(axis=1)
    weight /= weight.sum()
    sd = np.sqrt(weight**2 @ sd_mm**2)
    sd = np.concatenate([sd, _standing_sd(sd, sampling)])
    band = np.searchsorted(EDGES, ORDER_OF, side="right") - 1
    band = np.concatenate([band, np.zeros(len(sd) - len(band), dtype=np.int64)])
    scatter = raw.shaken * noise.scatter(raw.first.one.setup, raw.shaken.shape[1]) * np.linalg.norm(weight)
    return Block(
        raw.name, raw.first.model, raw.first.one, sampling, weight @ raw.rows, sd, scatter,
        band + number * len(EDGES), len(raw.rows), noise.measured, places_of(raw.first),
    )  # fmt: skip


def _target_block(raw: _Raw, noise: CircleNoise, number: int) -> Block:
    table, count = raw.first.one.table, len(raw.rows)
    sd, measured = target_sd(Repeated(raw.first.one.setup, raw.rows, raw.shaken), _alike(raw.first.one))
    if isinstance(table, PoseTable) and not measured:
        sd = np.full(len(sd), POSE_MM)
    scatter = raw.shaken * noise.scatter(raw.first.one.setup, raw.shaken.shape[1]) / np.sqrt(count)
    band = np.full(len(sd), number * len(EDGES))
    y, sd = raw.rows.mean(axis=0), sd / np.sqrt(count)
    return Block(
        raw.name, raw.first.model, raw.first.one, None, y, sd, scatter,
        band, count, measured, places_of(raw.first),
    )  # fmt: skip


def _alike(one: Observation) -> Integers:
    """A number for each entry that readings of the same place, reached the same way, share."""
    table, keys = one.table, _keys(one)
    if isinstance(table, PoseTable):
        visit = visits(table.q[one.rows], _SAME_RAD)
        keys = np.stack([np.repeat(visit, 3), np.tile(np.arange(3), len(visit))], axis=1)
    return np.asarray(np.unique(keys, axis=0, return_inverse=True)[1], dtype=np.int64).ravel()


def _keys(one: Observation) -> Integers:
    """Where and how each reading was taken: whole numbers (m, k)."""
    table, rows = one.table, one.rows
    if isinstance(table, RadialTable):
        return np.stack([table.target, table.orientation], axis=1)[rows]
    if isinstance(table, RepeatabilityTable):
        ways = np.select([table.approach == "out", table.approach == "in"], [1, 2], 0)
        return np.stack([table.target, ways], axis=1)[rows]
    return np.round(table.q[rows] / _SAME_RAD).astype(np.int64)


def _standing_sd(sd_mm: Array, sampling: Sampling) -> Array:
    """Of the means over stands, sum and difference of each: slow noise averages like white noise of its strength."""
    half = len(ORDER_OF) // 2
    slow = (ORDER_OF[:half] > 0) & (ORDER_OF[:half] < _SLOW)
    power = np.array([np.mean(sd_mm[:half][slow] ** 2), np.mean(sd_mm[half:][slow] ** 2)])
    return np.concatenate([np.sqrt(power / share) for share in sampling.stand_share] or [np.empty(0)])
