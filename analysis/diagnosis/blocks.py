"""Blocks: repeated runs combined into one set of readings with the noise of their mean.

Neighbouring readings on a circle are correlated, so circles are decomposed into orders (cycles per lap) of the sum and
of the difference of the gauges; `repeat_noise` estimates the noise of each order. Readings at targets are used as they
are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnosis.observed_run import ORDER_OF, ORDERS, ObservedRun, Sampling, bridging
from analysis.diagnosis.repeat_noise import POSE_MM, CircleNoise, Repeated, circle_noise, target_sd
from analysis.diagnosis.run_scatter import ScatteredRuns, drift_waves, scatter_columns, scatter_response, without_unseen
from analysis.diagnosis.run_setups import with_effects
from analysis.diagnosis.stamp_noise import stamp_noise
from analysis.fitting.observation import Observation, residuals_of
from analysis.kinematics.arm import Array, Integers
from analysis.measures.pose import groups as visits
from analysis.model.predict import Model, SetUp
from analysis.traces.tables import PoseTable, RadialTable, RepeatabilityTable
from rigs.effects import Effect

BAND_EDGES = (0, 3, 8, 16, 30, 60, 120, ORDERS)
"""Edges of the bands of orders; a residual that no effect explains may have its own strength in each band. Chosen:
bands of about one octave, so that joint motion (below order 8), gears and probe noise are separate."""
_SLOW = 8
"""Orders below this are taken to be as slow as the noise of a robot at rest. Chosen: one eighth of a lap lasts several
seconds, which is longer than the correlation times of most noise."""
_SAME_RAD = 3e-4
"""Joint angles that all differ by less than this count as the same posture. Controllers report angles in steps of about
a third of it."""


@dataclass(frozen=True)
class Block:
    """Repeated runs of one test and direction.

    `model` comes from their rig file; `one` is the first run, whose feedback represents all of them. `y_mm` (N,) is
    their weighted mean residual and `sd_mm` (N,) its standard deviation without scatter between runs; `scatter_mm` (N,
    c) is what one standard deviation of the scatter of joints and ball adds, and `stamps_mm` (N, s) what one of the
    scatter of stamps adds at a few angles. `apart_mm` (n, N) are the deviations of the n runs from their mean, and
    `steady_mm` (n, N) the same without what stamps are expected to have added. `band` (N,) numbers the entries that
    share a strength. `measured` states whether the noise comes from repeats, and `targets_key` is equal for runs that
    repeat the same targets.
    """

    name: str
    model: Model
    one: Observation
    sampling: Sampling | None
    y_mm: Array
    sd_mm: Array
    scatter_mm: Array
    stamps_mm: Array
    apart_mm: Array
    steady_mm: Array
    band: Integers
    count: int
    measured: bool
    targets_key: bytes

    def whitened(self, values: Array) -> Array:
        """Return readings (m, k, …) mm as entries (N, …) in standard deviations of the noise."""
        return self.white(entries(values, self.sampling))

    def white(self, vector: Array) -> Array:
        """Return entries (N, …) mm in standard deviations of the noise."""
        return vector / self.sd_mm.reshape(-1, *[1] * (vector.ndim - 1))


def entries(values: Array, sampling: Sampling | None) -> Array:
    """Return readings (m, k, …) mm as entries (N, …) mm of a block: a circle's by orders, other readings unchanged."""
    return sampling.vector(values) if sampling else values.reshape(-1, *values.shape[2:])


def blocks_of(runs: Sequence[ObservedRun], setups: Mapping[str, SetUp], known: Sequence[Effect] = ()) -> list[Block]:
    """Return the blocks of all runs about fitted set-ups. The effects `known` are included in the model, so that the
    residuals (N,) do not contain them."""
    groups: dict[tuple[str, bytes], list[ObservedRun]] = {}
    for run in runs:
        groups.setdefault((run.name, targets_key(run)), []).append(run)
    grouped = [_grouped(name, members, setups, known) for (name, _), members in groups.items()]
    circles = [raw for raw in grouped if raw.first.sampling]
    grids = [raw.first.sampling.averaged for raw in circles if raw.first.sampling]
    noise = circle_noise([_repeated(raw) for raw in circles], float(np.mean(grids)) if grids else 1.0)
    sds = dict(zip([raw.name for raw in circles], noise.sd_mm, strict=True))  # a circle's name is its own
    numbers = {name: k for k, name in enumerate(dict.fromkeys(raw.first.one.setup for raw in grouped))}
    return [
        _circle_block(raw, sds[raw.name], noise, numbers[raw.first.one.setup])
        if raw.first.sampling
        else _target_block(raw, noise, numbers[raw.first.one.setup])
        for raw in grouped
    ]


def targets_key(run: ObservedRun) -> bytes:
    """Return bytes that are equal for runs that repeat each other reading by reading. The key of circles (…) is empty,
    because their name identifies them."""
    if run.sampling:
        return b""
    return _visit_keys(run.one).tobytes()


@dataclass(frozen=True)
class _RepeatedRuns:
    """Residuals `rows` (n, N) mm of n repeated runs, and the responses of the readings to a unit scatter: `response`
    (N, c) mm to a constant one, and `drifting` (w, N, c) mm to the waves of one that drifts, which has none at targets.
    `stamps` (N, c) mm is what one standard deviation of the scatter of stamps adds to a run at a few angles.
    """

    name: str
    first: ObservedRun
    rows: Array
    response: Array
    drifting: Array
    stamps: Array


def _grouped(
    name: str, members: Sequence[ObservedRun], setups: Mapping[str, SetUp], known: Sequence[Effect]
) -> _RepeatedRuns:
    # Periods of standing are compared only if every run has them before and after its lap.
    if not all(run.sampling and run.sampling.stands for run in members):
        members = [replace(run, sampling=run.sampling and run.sampling.without_stands()) for run in members]
    # All members are circles, or none.
    if samplings := [run.sampling for run in members if run.sampling]:
        samplings = bridging(samplings)
        members = [replace(run, sampling=one) for run, one in zip(members, samplings, strict=True)]
    residuals = [residuals_of(run.model, [run.one], setups)[0] for run in with_effects(members, known)]
    vectors = [entries(left, run.sampling) for left, run in zip(residuals, members, strict=True)]
    first = members[0]
    stamps = np.empty((len(vectors[0]), 0))
    if samplings:
        predicted = [run.one.values - left for run, left in zip(members, residuals, strict=True)]
        stamps = stamp_noise(samplings, [run.one.t_s for run in members], predicted)
    response = scatter_response(first.model, first.one, setups[first.one.setup])
    waves = drift_waves(_share_of_run(first.one)) if first.sampling else np.empty((0, len(response)))
    drifting = [entries(wave[:, None, None] * response, first.sampling) for wave in waves]
    constant = entries(response, first.sampling)
    # Averaging needs repeats of the same targets.
    alike = [vector for vector in vectors if len(vector) == len(vectors[0])]
    drifts = np.reshape(drifting, (len(drifting), *constant.shape))
    return _RepeatedRuns(name, first, np.array(alike), constant, drifts, stamps)


def _repeated(raw: _RepeatedRuns) -> Repeated:
    """Return repeated laps alone, without the periods of standing."""
    assert raw.first.sampling is not None  # noqa: S101 - circles have one
    orders, laps = len(ORDER_OF), len(raw.first.sampling.share)
    rows, response, drifting, stamps = raw.rows, raw.response, raw.drifting, raw.stamps
    return Repeated(
        raw.first.one.setup, rows[:, :orders], response[:orders], drifting[:, :orders], laps, stamps[:orders]
    )


def _share_of_run(one: Observation) -> Array:
    """Return the share (m,) of the duration of its run at which each reading was taken."""
    t_s = one.path.t_s
    share: Array = (one.t_s - t_s[0]) / (t_s[-1] - t_s[0])
    return share


def _circle_block(raw: _RepeatedRuns, sd_mm: Array, noise: CircleNoise, number: int) -> Block:
    """Return the block of repeated circles, given the noise sd_mm (n, N) of each run; `number` is that of
    their set-up."""
    sampling = raw.first.sampling
    assert sampling is not None  # noqa: S101 - circles have one
    weight = 1 / (sd_mm[:, BAND_EDGES[4] > ORDER_OF] ** 2).mean(axis=1)
    weight /= weight.sum()
    few = float(np.linalg.norm(weight))
    sd = np.sqrt(weight**2 @ sd_mm**2)
    sd = np.concatenate([sd, _standing_sd(sd, sampling, raw.first.step_mm)])
    # The assumed noise of a run that was not repeated contains the drift.
    drifting = raw.drifting if noise.measured else raw.drifting[:0]
    scatter = noise.scatter(raw.first.one.setup)
    columns = few * scatter_columns(raw.response, drifting, scatter)
    repeats = ScatteredRuns(raw.rows - raw.rows.mean(axis=0), raw.response, drifting, raw.stamps)
    band = np.searchsorted(BAND_EDGES, ORDER_OF, side="right") - 1
    band = np.concatenate([band, np.zeros(len(sd) - len(band), dtype=np.int64)])
    return Block(
        raw.name, raw.first.model, raw.first.one, sampling, weight @ raw.rows, sd, without_unseen(columns, sd),
        few * raw.stamps, repeats.apart, repeats.without_stamps(scatter, sd / few), band + number * len(BAND_EDGES),
        len(raw.rows), noise.measured, targets_key(raw.first),
    )  # fmt: skip


def _target_block(raw: _RepeatedRuns, noise: CircleNoise, number: int) -> Block:
    """Return the block of repeated runs at targets; `number` is that of their set-up."""
    table, count = raw.first.one.table, len(raw.rows)
    sd, measured = target_sd(raw.rows, raw.response, _visit_numbers(raw.first.one))
    if isinstance(table, PoseTable) and not measured:
        sd = np.full(len(sd), POSE_MM)
    scatter = scatter_columns(raw.response, raw.drifting, noise.scatter(raw.first.one.setup)) / np.sqrt(count)
    band = np.full(len(sd), number * len(BAND_EDGES))
    y, sd = raw.rows.mean(axis=0), sd / np.sqrt(count)
    return Block(
        raw.name, raw.first.model, raw.first.one, None, y, sd, scatter, raw.stamps,
        raw.rows - y, raw.rows - y, band, count, measured, targets_key(raw.first),
    )  # fmt: skip


def _visit_numbers(one: Observation) -> Integers:
    """Return an integer for each entry (N,) which readings of one place, reached in the same way, share."""
    table, keys = one.table, _visit_keys(one)
    if isinstance(table, PoseTable):
        visit = visits(table.q[one.rows], _SAME_RAD)
        keys = np.stack([np.repeat(visit, 3), np.tile(np.arange(3), len(visit))], axis=1)
    return np.asarray(np.unique(keys, axis=0, return_inverse=True)[1], dtype=np.int64).ravel()


def _visit_keys(one: Observation) -> Integers:
    """Return integers (m, k) that describe where and how each reading was taken."""
    table, rows = one.table, one.rows
    if isinstance(table, RadialTable):
        return np.stack([table.target, table.orientation], axis=1)[rows]
    if isinstance(table, RepeatabilityTable):
        ways = np.select([table.approach == "out", table.approach == "in"], [1, 2], 0)
        return np.stack([table.target, ways], axis=1)[rows]
    return np.round(table.q[rows] / _SAME_RAD).astype(np.int64)


def _standing_sd(sd_mm: Array, sampling: Sampling, step_mm: float) -> Array:
    """Return the standard deviation (2 s,) mm of the means over s periods of standing, for the sum and the difference
    of the gauges. Slow noise averages like white noise of the same strength; all readings of a gauge that stands are
    rounded to the same step, as are those of repeats that differ by less."""
    half = len(ORDER_OF) // 2
    slow = (ORDER_OF[:half] > 0) & (ORDER_OF[:half] < _SLOW)
    power = np.array([np.mean(sd_mm[:half][slow] ** 2), np.mean(sd_mm[half:][slow] ** 2)])
    return np.concatenate([np.sqrt(power / share + step_mm**2 / 12) for share in sampling.stand_share] or [np.empty(0)])
