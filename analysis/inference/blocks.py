"""Blocks: repeated runs as one set of readings with the noise of their mean, and each one on the simulator."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeVar

import numpy as np

from analysis.inference.noise import (
    CircleNoise,
    Repeated,
    ScatteredRuns,
    circle_noise,
    drift_waves,
    scatter_columns,
    scatter_response,
    stamp_noise,
    target_sd,
    without_unseen,
)
from analysis.inference.observation import (
    ORDER_OF,
    ORDER_OF_TREND,
    ORDERS,
    STAMP_SCATTER,
    TREND_ORDERS,
    Observation,
    ObservedRun,
    Sampling,
    bridging,
    predicted_in_scene,
    residuals_of,
)
from analysis.inference.setups import moved_setup, with_effects, without_origin
from analysis.kinematics.arm import Array, Integers
from analysis.measures.pose import groups as visits
from analysis.model.predict import Model, SetUp, driven, posed
from analysis.model.scene import Scene, apply
from analysis.traces.kind import SAME_RAD
from rigs.calibration import is_sine, sine_of
from rigs.effects import Effect, late_stamps, turned
from rigs.schema.effect import scaled, size_of

# ----------------------------------------------------------------------------------------------------------------------
# Results that are kept for as long as they are among the most recent ones.

_Key = TypeVar("_Key", bound=Hashable)
_One = TypeVar("_One")


def recent(kept: dict[_Key, _One], key: _Key, compute: Callable[[], _One], most: int) -> _One:
    """Return what is kept under a key, or compute it; of more than `most` the least recently used one is dropped."""
    result = kept[key] = kept.pop(key) if key in kept else compute()
    if len(kept) > most:
        del kept[next(iter(kept))]
    return result


# ----------------------------------------------------------------------------------------------------------------------
# Blocks: repeated runs combined into one set of readings with the noise of their mean.
#
# Neighbouring readings on a circle are correlated, so circles are decomposed into orders (cycles per lap) of the sum
# and of the difference of the gauges; `noise` estimates the noise of each order. Readings at targets are used
# as they are.

BAND_EDGES = (0, 3, 8, 16, 30, 60, 120, ORDERS)
"""Edges of the bands of orders; a residual that no effect explains may have its own strength in each band. Chosen:
bands of about one octave, so that joint motion (below order 8), gears and probe noise are separate."""
_SLOW = 8
"""Orders below this are taken to be as slow as the noise of a robot at rest. Chosen: one eighth of a lap lasts several
seconds, which is longer than the correlation times of most noise."""
_BORROWED = 2.0
"""Degrees of freedom with which each order of a trend counts what is expected of it beside what few repeats show."""


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


def blocks_of(runs: Sequence[ObservedRun], setups: Mapping[str, SetUp], effects: Sequence[Effect] = ()) -> list[Block]:
    """Return the blocks of all runs about fitted set-ups. The `effects` are included in the model, so that the
    residuals (N,) do not contain them."""
    groups: dict[tuple[str, bytes], list[ObservedRun]] = {}
    for run in runs:
        groups.setdefault((run.name, targets_key(run)), []).append(run)
    grouped = [_grouped(name, members, setups, effects) for (name, _), members in groups.items()]
    circles = [raw for raw in grouped if raw.first.sampling]
    grids = [raw.first.sampling.averaged for raw in circles if raw.first.sampling]
    noise = circle_noise([_repeated(raw) for raw in circles], float(np.mean(grids)) if grids else 1.0)
    sds = dict(zip([raw.name for raw in circles], noise.sd_mm, strict=True))  # a circle's name is its own
    kinds = [_strength_of(raw.first.one) for raw in grouped]
    numbers = {name: k for k, name in enumerate(dict.fromkeys(kinds))}
    return [
        _circle_block(raw, sds[raw.name], noise, numbers[kind])
        if raw.first.sampling
        else _target_block(raw, noise, numbers[kind])
        for raw, kind in zip(grouped, kinds, strict=True)
    ]


def _strength_of(observation: Observation) -> str:
    """Return what names the strength of the residual (m, k): that of the set-up, and of all sockets together, since one
    ball is seated in them."""
    return observation.setup if observation.table.kind.parts(observation.table) is None else observation.table.test


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
    name: str, members: Sequence[ObservedRun], setups: Mapping[str, SetUp], effects: Sequence[Effect]
) -> _RepeatedRuns:
    # Periods of standing are compared only if every run has them before and after its lap.
    if not all(run.sampling and run.sampling.stands for run in members):
        members = [replace(run, sampling=run.sampling and run.sampling.without_stands()) for run in members]
    # A trend is compared only over as many laps.
    if len({len(run.sampling.trend) for run in members if run.sampling}) > 1:
        members = [replace(run, sampling=run.sampling and run.sampling.without_trend()) for run in members]
    # All members are circles, or none.
    if samplings := [run.sampling for run in members if run.sampling]:
        samplings = bridging(samplings)
        members = [replace(run, sampling=sampling) for run, sampling in zip(members, samplings, strict=True)]
    residuals = [residuals_of(run.model, [run.one], setups)[0] for run in with_effects(members, effects)]
    vectors = [entries(residual, run.sampling) for residual, run in zip(residuals, members, strict=True)]
    first = members[0]
    stamps = np.empty((len(vectors[0]), 0))
    if samplings:
        predicted = [run.one.values - residual for run, residual in zip(members, residuals, strict=True)]
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


def _share_of_run(observation: Observation) -> Array:
    """Return the share (m,) of the duration of its run at which each reading was taken."""
    t_s = observation.path.t_s
    share: Array = (observation.t_s - t_s[0]) / (t_s[-1] - t_s[0])
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
    sd = np.concatenate([sd, _standing_sd(sd, sampling, raw.first.step_mm), _trend_sd(raw, sd, noise)])
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
    if table.kind.of_places and not measured:
        sd = np.full(len(sd), table.kind.assumed_sd_mm)
    scatter = scatter_columns(raw.response, raw.drifting, noise.scatter(raw.first.one.setup)) / np.sqrt(count)
    band = np.full(len(sd), number * len(BAND_EDGES))
    y, sd = raw.rows.mean(axis=0), sd / np.sqrt(count)
    return Block(
        raw.name, raw.first.model, raw.first.one, None, y, sd, scatter, raw.stamps,
        raw.rows - y, raw.rows - y, band, count, measured, targets_key(raw.first),
    )  # fmt: skip


def _visit_numbers(observation: Observation) -> Integers:
    """Return an integer for each entry (N,) which readings of one place, reached in the same way, share."""
    table, keys = observation.table, _visit_keys(observation)
    if table.kind.of_places:
        visit, sides = visits(table.q[observation.rows], SAME_RAD), table.kind.sides(table)
        reached = visit[:, None] if sides is None else np.column_stack([visit, sides[observation.rows]])
        keys = np.column_stack([np.repeat(reached, 3, axis=0), np.tile(np.arange(3), len(visit))])
    return np.asarray(np.unique(keys, axis=0, return_inverse=True)[1], dtype=np.int64).ravel()


def _visit_keys(observation: Observation) -> Integers:
    """Return integers (m, k) that describe where and how each reading was taken."""
    return observation.table.kind.visits(observation.table)[observation.rows]


def _standing_sd(sd_mm: Array, sampling: Sampling, step_mm: float) -> Array:
    """Return the standard deviation (2 s,) mm of the means over s periods of standing, for the sum and the difference
    of the gauges. Slow noise averages like white noise of the same strength; all readings of a gauge that stands are
    rounded to the same step, as are those of repeats that differ by less."""
    half = len(ORDER_OF) // 2
    slow = (ORDER_OF[:half] > 0) & (ORDER_OF[:half] < _SLOW)
    power = np.array([np.mean(sd_mm[:half][slow] ** 2), np.mean(sd_mm[half:][slow] ** 2)])
    return np.concatenate([np.sqrt(power / share + step_mm**2 / 12) for share in sampling.stand_share] or [np.empty(0)])


def _trend_sd(raw: _RepeatedRuns, sd_mm: Array, noise: CircleNoise) -> Array:
    """Return the standard deviation (14,) mm of the trend from lap to lap, none without one, given that (N,) of the
    mean of laps: that of one lap, and as much more as repeated runs show beside the drift of joints and ball. Where
    nothing is measured, this drift is part of it."""
    sampling = raw.first.sampling
    if sampling is None or not len(sampling.trend):
        return np.empty(0)
    trend, runs = slice(-len(ORDER_OF_TREND), None), len(raw.rows)
    squares = len(sampling.trend) * sd_mm[np.flatnonzero(ORDER_OF < TREND_ORDERS)] ** 2
    scatter = noise.scatter(raw.first.one.setup).drifting(raw.response.shape[1])
    drifting: Array = ((raw.drifting[:, trend] * scatter) ** 2).sum(axis=(0, 2))
    if not noise.measured or runs < 2:
        return np.asarray(np.sqrt(squares + drifting), dtype=float)
    apart = raw.rows[:, trend] - raw.rows[:, trend].mean(axis=0)
    expected = runs * squares + drifting  # of one run
    channel = np.arange(len(ORDER_OF_TREND)) * 2 // len(ORDER_OF_TREND)
    alike = channel * TREND_ORDERS + ORDER_OF_TREND
    for number in np.unique(alike).tolist():
        entries = np.flatnonzero(alike == number)
        of_one, freedom = float(expected[entries].mean()), (runs - 1) * len(entries)
        shown = (float((apart[:, entries] ** 2).sum()) + _BORROWED * of_one) / (freedom + _BORROWED)
        squares[entries] += max(shown - of_one, 0.0) / runs
    return np.asarray(np.sqrt(squares), dtype=float)


# ----------------------------------------------------------------------------------------------------------------------
# One block about a set-up on the simulator: its readings, their slopes by joints and by the set-up, and what effects
# add to them, one by one as columns.

_STEP_DEG = 1e-4
"""Step of the derivatives by a joint angle. Readings are linear over such a step, which moves the tool of an arm of one
metre by 2 µm, and far from the limits of floating-point arithmetic."""
_STEP_MM = 0.01
"""Step of the derivatives by a set-up term. Readings are linear over such a step."""
_EARLY, _READING = ("time", "arm"), ("setup", "gauge")
"""Stages of effects before the errors of joints, and of those that do not move the tool."""
_RIGID = ("arm", "tool")
"""Stages of effects whose columns are computed at a healthy size and multiplied. They move the tool in proportion to
their size, but the ball of a column does not move with it: at 13 mm of a length the column was no slope of the fit."""
_SCENES, _ERRORS = 4, 64
"""Number of scenes, and of errors of joints, that are kept for each block, at some 0.1 MB each: a fit returns to those
of the present effects."""
_FEW = 64
"""Number of effects whose readings are computed at a time: about what fits a processor's cache."""


@dataclass(frozen=True, eq=False)
class SimulatedBlock:
    """One block about a set-up, simulated (m readings of k gauges).

    `known` lists the effects found so far, which the readings contain beside those of the rig file.
    """

    block: Block
    known: tuple[Effect, ...]
    setup: SetUp
    _scenes: dict[tuple[Effect, ...], Scene] = field(default_factory=dict, init=False, repr=False)
    _errors: dict[tuple[tuple[Effect, ...], Effect], Array] = field(default_factory=dict, init=False, repr=False)
    _moved: dict[tuple[Effect, ...], tuple[Scene, Scene]] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def scene(self) -> Scene:
        """The scene up to the tool."""
        return self.scene_with(self.known)

    @cached_property
    def base(self) -> Array:
        """The readings (m, k) mm."""
        return self.read(self.known, self.scene, self.setup)

    @cached_property
    def slopes(self) -> Array:
        """The derivatives (m, k, axes) of the readings in mm by the errors of the joints in rad."""
        slopes = np.empty((*self.base.shape, self.block.model.arm.axes))
        for axis in range(1, self.block.model.arm.axes + 1):
            effects = (*self.known, turned(axis, _STEP_DEG))
            slopes[:, :, axis - 1] = self.read(effects, self.scene_with(effects), self.setup) - self.base
        slopes /= np.radians(_STEP_DEG)
        return slopes

    @cached_property
    def by_setup(self) -> Array:
        """The change (N, t) of the whitened readings for a mm of each term of the set-up."""
        steps = _STEP_MM * np.eye(self.block.one.table.kind.setup_terms)
        setups = [moved_setup(self.setup, self.block.one.table, step) for step in steps]
        changed = np.stack([self.read(self.known, self.scene, setup) - self.base for setup in setups], axis=2)
        return self.whitened(changed) / _STEP_MM

    def scene_with(self, effects: Sequence[Effect]) -> Scene:
        """Return the scene up to the tool with `effects` in place of the known ones."""
        model = _with(self.block.model, *effects)
        early = _early(model.effects)
        errors = [self._error(early, effect) for effect in model.effects if effect.STAGE == "joint"]
        joints = self._joints(early)
        return posed(model, self.block.one.path, replace(joints, link_q=sum(errors, start=joints.link_q)))

    def _joints(self, early: tuple[Effect, ...]) -> Scene:
        """Return the scene before joints have errors, given the effects of earlier stages."""

        def compute() -> Scene:
            return driven(replace(self.block.model, effects=early), self.block.one.path)

        return recent(self._scenes, early, compute, _SCENES)

    def _error(self, early: tuple[Effect, ...], effect: Effect) -> Array:
        """Return the errors (n, axes) rad of the joints that one effect makes after those of earlier stages. They are
        kept, because errors of joints add and a fit changes few effects at a time."""
        joints = self._joints(early)

        def compute() -> Array:
            error: Array = apply([effect], "joint", joints).link_q - joints.link_q
            return error

        return recent(self._errors, (early, without_origin(effect)), compute, _ERRORS)

    def read(self, effects: Sequence[Effect], scene: Scene, setup: SetUp) -> Array:
        """Return the readings (m, k) mm of a scene up to the tool."""
        return predicted_in_scene(_with(self.block.model, *effects), self.block.one, scene, setup)

    def at_readings(self, values: Array) -> Array:
        """Return values (n, …) at the samples of the path, in any unit, at the readings, (m, …)."""
        at_rows: Array = values[self.block.one.samples]
        return at_rows

    def entries(self, readings: Array) -> Array:
        """Return readings (m, k, …) mm as entries (N, …) mm of the block."""
        return entries(readings, self.block.sampling)

    def whitened(self, readings: Array) -> Array:
        """Return readings (m, k, …) mm as entries (N, …) in standard deviations of the noise."""
        return self.block.white(self.entries(readings))

    def by_joint(self, axis: int, off: Array) -> Array:
        """Return the change (N, c) of the whitened readings for errors (n, c) rad of a joint (1 … 6)."""
        return self.whitened(self.slopes[:, :, axis - 1, None] * self.at_readings(off)[:, None])

    def late(self, effect: Effect) -> Array:
        """Return the change (N, c) of the whitened readings of a circle if the errors of joints that an effect makes
        come as much later as each of c effects of the stamps has everything, at its healthy size; zero at targets."""
        stamps = late_stamps()
        if not self.block.sampling:
            return np.zeros((len(self.block.y_mm), len(stamps)))
        early = _early((*self.block.model.effects, *self.known))
        now, later = self._error(early, effect), [self._error((*early, stamp), effect) for stamp in stamps]
        change = np.stack([self.at_readings(error - now) for error in later], axis=2)
        return self.whitened(np.einsum("mka,mac->mkc", self.slopes, change))

    def scattered(self, effect: Effect) -> Array:
        """Return the change (N, 1) of the whitened readings of a circle if the errors of joints that an effect makes
        are on average those of a moment earlier and a moment later, as with stamps that scatter; zero at targets."""
        if not self.block.sampling:
            return np.zeros((len(self.block.y_mm), 1))
        early = _early((*self.block.model.effects, *self.known))
        moved = recent(self._moved, early, lambda: self._moment_apart(self._joints(early)), _SCENES)
        earlier, later = (apply([effect], "joint", scene).link_q - scene.link_q for scene in moved)
        now = self._error(early, effect)
        change = self.at_readings((earlier + later) / 2 - now)
        return self.whitened(np.einsum("mka,ma->mk", self.slopes, change)[:, :, None])

    def _moment_apart(self, joints: Scene) -> tuple[Scene, Scene]:
        """Return a scene before joints have errors as it was a moment earlier, and as it will be a moment later."""
        moment_s = STAMP_SCATTER * float(np.median(np.diff(joints.t_s[self.block.one.samples])))
        return joints.taken_at(joints.t_s - moment_s), joints.taken_at(joints.t_s + moment_s)

    def columns(self, effects: Sequence[Effect]) -> Array:
        """Return what each effect adds to the whitened readings, (N, p)."""
        few = [effects[begin : begin + _FEW] for begin in range(0, len(effects), _FEW)]
        return np.concatenate([self.whitened(self._added_by(batch)) for batch in few], axis=1)

    def _added_by(self, effects: Sequence[Effect]) -> Array:
        """Return what each effect adds to the readings, (m, k, p) mm."""
        early = _early((*self.block.model.effects, *self.known))
        added = np.zeros((len(effects), *self.base.shape))
        if waves := [k for k, effect in enumerate(effects) if is_sine(effect)]:
            added[waves] = self._added_by_waves(early, [effects[k] for k in waves])
        for k, effect in enumerate(effects):
            if is_sine(effect):
                continue
            if effect.STAGE == "joint":
                error = self._error(early, effect)
                for axis in _turned_axes(error):
                    added[k] += self._slopes_of_axes[axis] * self.at_readings(error[:, axis])[:, None]
            else:
                times = max(1.0, abs(size_of(effect))) if effect.STAGE in _RIGID else 1.0
                present = (*self.known, scaled(effect, 1 / times))
                scene = self.scene if effect.STAGE in _READING else self.scene_with(present)
                added[k] = times * (self.read(present, scene, self.setup) - self.base)
        return np.moveaxis(added, 0, 2)

    def _added_by_waves(self, early: tuple[Effect, ...], waves: Sequence[Effect]) -> Array:
        """Return what sines of joints over their angles add, (p, m, k) mm: most forms are, and together they take a
        quarter of the time."""
        axis, order, phase, size = np.array([sine_of(wave) for wave in waves]).T
        joint = axis.astype(np.int64) - 1
        angles = self.at_readings(self._joints(early).q).T[joint]
        error = size[:, None] * np.sin(order[:, None] * angles + phase[:, None])
        added: Array = self._slopes_of_axes[joint] * error[:, :, None]
        return added

    @cached_property
    def _slopes_of_axes(self) -> Array:
        """The derivatives (axes, m, k) by each joint, those of one joint side by side in memory."""
        return np.ascontiguousarray(np.moveaxis(self.slopes, 2, 0))


@dataclass(frozen=True, eq=False)
class SharedBlock(SimulatedBlock):
    """A simulated block of several linearisations, which keeps the columns (N,) of every effect that it was asked for:
    those of three runs of a circle take 15 MB."""

    _columns: dict[Effect, Array] = field(default_factory=dict, init=False, repr=False)

    def columns(self, effects: Sequence[Effect]) -> Array:
        """Return what each effect adds to the whitened readings, (N, p)."""
        new = [effect for effect in dict.fromkeys(effects) if effect not in self._columns]
        if new:
            self._columns.update(zip(new, super().columns(new).T, strict=True))
        return np.stack([self._columns[effect] for effect in effects], axis=1)


def _turned_axes(error: Array) -> list[int]:
    """Return the numbers (from 0) of the joints that have errors among (n, axes) rad. A product of few rows takes a
    quarter of the time that numpy's `any` takes along many short ones."""
    return np.flatnonzero(np.ones(len(error)) @ (error != 0)).tolist()


def _early(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """Return the effects of the stages before that of the joints."""
    return tuple(without_origin(effect) for effect in effects if effect.STAGE in _EARLY)


def _with(model: Model, *effects: Effect) -> Model:
    return replace(model, effects=(*model.effects, *effects))
