"""Blocks: repeated runs combined, and their simulation with other effects or a different set-up."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeVar

import numpy as np

from analysis.diagnosis.evidence.noise import (
    PRIOR_FREEDOM,
    CircleNoise,
    Repeated,
    circle_noise,
    drift_waves,
    scatter_columns,
    scatter_response,
    stamp_noise,
    target_sd,
    without_unseen,
)
from analysis.diagnosis.evidence.observation import (
    ORDER_OF,
    ORDER_OF_TREND,
    ORDERS,
    STAMP_SCATTER,
    TREND_ORDERS,
    ObservedRun,
    Sampling,
    bridging,
    predicted_in_scene,
    residual_of,
)
from analysis.diagnosis.evidence.setups import STEP_MM, moved_setup, with_effects, without_origin
from analysis.procedures.pose import groups as visits
from analysis.procedures.shared.test_kind import kind_of
from analysis.robot.kinematics.arm import Array, Integers, cos_sin, drive_angles
from analysis.robot.predict import Model, ModelScene, Motion, SetUp, SetUps, apply, driven, posed
from analysis.runs.tables import SAME_RAD
from rigs.calibration import is_sine, sine_of
from rigs.effects import Effect, late_stamps, turned
from rigs.schema.effect import scaled, size_of

# ----------------------------------------------------------------------------------------------------------------------
# Cache of the most recent results.

_Key = TypeVar("_Key", bound=Hashable)
_One = TypeVar("_One")


def recent(kept: dict[_Key, _One], key: _Key, compute: Callable[[], _One], most: int) -> _One:
    """The value cached under a key, or computed. Above `most` values, the least recently used is dropped."""
    result = kept[key] = kept.pop(key) if key in kept else compute()
    if len(kept) > most:
        del kept[next(iter(kept))]
    return result


# ----------------------------------------------------------------------------------------------------------------------
# Blocks: repeated runs combined into a set of readings with the noise of their mean.
#
# Neighbouring readings on a circle are correlated. Circles are therefore decomposed into orders (cycles per lap) of the
# sum and the difference of the gauges, and `noise` estimates the noise of each order. Readings at targets are used
# directly.

BAND_EDGES = (0, 3, 8, 16, 30, 60, 120, ORDERS)
"""Edges of the bands of orders, each with its own strength of the residual. Chosen: about an octave, so that joint
motion (below order 8), gears and probe noise are separated.
"""
_SLOW = BAND_EDGES[2]
"""Orders below this are as slow as the noise of a robot at rest. Chosen: an eighth of a lap lasts several seconds."""


_SHOW_NOISE = 20
"""Number of poses from which the residuals show the noise. Source: 24 poses of an independent generator with noise of
21.5 µm show 17.5, 50 with 51 show 44, 47 with 39 show 36; the assumed noise was 71.
"""


@dataclass(frozen=True, kw_only=True)
class Block(ObservedRun):
    """Repeated runs with the same test and direction as a single run: the first, whose feedback represents all."""

    y_mm: Array
    """Weighted mean residual (N,)."""
    sd_mm: Array
    """Standard deviation (N,) excluding scatter between runs."""
    scatter_mm: Array
    """Response (N, c) to a standard deviation of the scatter of joints and ball."""
    stamps_mm: Array
    """Response (N, s) to a standard deviation of stamps, at a few angles."""
    apart_mm: Array
    """Deviations (n, N) of the n runs from their mean."""
    steady_mm: Array
    """The same without the expected contribution of stamps."""
    band: Integers
    """Index (N,) of entries with a common strength."""
    count: int
    """Number of runs."""
    measured: bool
    """True if the noise is estimated from repeats."""

    @property
    def drives(self) -> Motion:
        return self.path.motion.of_drives(self.model.arm)

    @property
    def turns(self) -> Array:
        """Range (axes,) of each drive at the readings, in turns."""
        return np.asarray(np.ptp(drive_angles(self.model.arm, self.table.q), axis=0) / (2 * np.pi))

    @property
    def shows_noise(self) -> bool:
        """True if readings show their noise even if not repeated: touches, or enough poses."""
        return self.facts.of_places and (self.facts.constants_apart or len(self.rows) >= _SHOW_NOISE)

    def whitened(self, values: Array) -> Array:
        """Readings (m, k, …) mm as entries (N, …) in noise standard deviations."""
        return self.white(self.entries(values))

    def white(self, vector: Array) -> Array:
        return vector / self.sd_mm.reshape(-1, *[1] * (vector.ndim - 1))


def blocks_of(runs: Sequence[ObservedRun], setups: SetUps, effects: Sequence[Effect] = ()) -> list[Block]:
    """Combine repeated runs to blocks about fitted set-ups; residuals exclude the `effects` in the model."""
    groups: dict[tuple[str, bytes], list[ObservedRun]] = {}
    for run in runs:  # runs at targets repeat each other reading by reading
        groups.setdefault((run.name, b"" if run.sampling else run.visits.tobytes()), []).append(run)
    grouped = [_repeated(members, setups, effects) for members in groups.values()]
    circles = [(first.sampling, raw) for first, raw in grouped if first.sampling]
    averaged = float(np.mean([sampling.averaged for sampling, _ in circles])) if circles else 1.0
    noise = circle_noise([raw.of_laps() for _, raw in circles], averaged)
    sds = iter(noise.sd_mm)
    # Each set-up has a separate residual strength. All sockets share a strength, because the same ball is seated.
    kinds = [
        first.setup if kind_of(first.table.test).parts(first.table) is None else first.table.test
        for first, _ in grouped
    ]
    numbers = {name: k for k, name in enumerate(dict.fromkeys(kinds))}
    return [
        _circle_block(first, raw, next(sds), noise, numbers[kind])
        if first.sampling
        else _target_block(first, raw, noise, numbers[kind])
        for (first, raw), kind in zip(grouped, kinds, strict=True)
    ]


def _repeated(
    members: Sequence[ObservedRun], setups: SetUps, effects: Sequence[Effect]
) -> tuple[ObservedRun, Repeated]:
    """The first of repeated runs in comparable form, and their residuals (n, N) mm with response to scatter."""
    # Standstills are compared only if every run has them before and after its lap.
    if not all(run.sampling and run.sampling.stands for run in members):
        members = [replace(run, sampling=run.sampling and run.sampling.without_stands()) for run in members]
    # A trend is compared over equal numbers of laps only.
    if len({len(run.sampling.trend) for run in members if run.sampling}) > 1:
        members = [replace(run, sampling=run.sampling and run.sampling.without_trend()) for run in members]
    # All members are circles, or none.
    if samplings := [run.sampling for run in members if run.sampling]:
        samplings = bridging(samplings)
        members = [replace(run, sampling=sampling) for run, sampling in zip(members, samplings, strict=True)]
    residuals = [residual_of(run, setups) for run in with_effects(members, effects)]
    vectors = [run.entries(residual) for residual, run in zip(residuals, members, strict=True)]
    first = members[0]
    stamps = np.empty((len(vectors[0]), 0))
    if samplings:
        predicted = [run.values - residual for run, residual in zip(members, residuals, strict=True)]
        stamps = stamp_noise(samplings, [run.t_s for run in members], predicted)
    response = scatter_response(first, setups[first.setup])
    waves = np.empty((0, len(response)))
    if first.sampling:
        t_s = first.path.t_s
        waves = drift_waves((first.t_s - t_s[0]) / (t_s[-1] - t_s[0]))
    drifting = [first.entries(wave[:, None, None] * response) for wave in waves]
    constant = first.entries(response)
    # Averaging requires repeats of the same targets.
    alike = [vector for vector in vectors if len(vector) == len(vectors[0])]
    drifts = np.reshape(drifting, (len(drifting), *constant.shape))
    laps = len(first.sampling.share) if first.sampling else 1
    return first, Repeated(first.setup, np.array(alike), constant, drifts, laps, stamps)


def _circle_block(first: ObservedRun, raw: Repeated, sd_mm: Array, noise: CircleNoise, number: int) -> Block:
    sampling = first.sampling
    assert sampling is not None  # noqa: S101 - circles have one
    weight = 1 / (sd_mm[:, BAND_EDGES[4] > ORDER_OF] ** 2).mean(axis=1)
    weight /= weight.sum()
    few = float(np.linalg.norm(weight))
    sd = np.sqrt(weight**2 @ sd_mm**2)
    # Slow noise of a standstill averages like white noise of the same strength. All readings of a resting gauge are
    # rounded to the same step, as are repeats with smaller differences.
    channels = np.split(sd, 2)
    slow = (ORDER_OF[: len(channels[0])] > 0) & (ORDER_OF[: len(channels[0])] < _SLOW)
    power = np.array([np.mean(channel[slow] ** 2) for channel in channels])
    standing = [np.sqrt(power / share + first.step_mm**2 / 12) for share in sampling.stand_share]
    sd = np.concatenate([sd, *standing, _trend_sd(sampling, raw, sd, noise)])
    # The assumed noise of a single run includes the drift.
    repeats = raw if noise.measured else replace(raw, drifting=raw.drifting[:0])
    scatter = noise.scatter(raw.setup)
    columns = few * scatter_columns(raw.response, repeats.drifting, scatter)
    band = np.searchsorted(BAND_EDGES, ORDER_OF, side="right") - 1
    band = np.concatenate([band, np.zeros(len(sd) - len(band), dtype=np.int64)])
    steady, numbers = repeats.without_stamps(scatter, sd / few), band + number * len(BAND_EDGES)
    return Block(
        **vars(first), y_mm=weight @ raw.rows, sd_mm=sd, scatter_mm=without_unseen(columns, sd),
        stamps_mm=few * raw.stamps, apart_mm=raw.deviations_mm, steady_mm=steady, band=numbers, count=len(raw.rows),
        measured=noise.measured,
    )  # fmt: skip


def _target_block(first: ObservedRun, raw: Repeated, noise: CircleNoise, number: int) -> Block:
    count = len(raw.rows)
    sd, measured = target_sd(raw.rows, raw.response, _visit_numbers(first))
    if first.facts.of_places and not measured:
        sd = np.full(len(sd), first.facts.assumed_sd_mm)
    scatter = scatter_columns(raw.response, raw.drifting, noise.scatter(raw.setup)) / np.sqrt(count)
    band = np.full(len(sd), number * len(BAND_EDGES))
    return Block(
        **vars(first), y_mm=raw.rows.mean(axis=0), sd_mm=sd / np.sqrt(count), scatter_mm=scatter, stamps_mm=raw.stamps,
        apart_mm=raw.deviations_mm, steady_mm=raw.deviations_mm, band=band, count=count, measured=measured,
    )  # fmt: skip


def _visit_numbers(run: ObservedRun) -> Integers:
    """An integer per entry (N,), equal for readings of the same place and approach."""
    table, keys = run.table, run.visits
    if run.facts.of_places:
        visit, sides = visits(table.q[run.rows], SAME_RAD), table.sides
        reached = visit[:, None] if sides is None else np.column_stack([visit, sides[run.rows]])
        keys = np.column_stack([np.repeat(reached, 3, axis=0), np.tile(np.arange(3), len(visit))])
    return np.asarray(np.unique(keys, axis=0, return_inverse=True)[1], dtype=np.int64).ravel()


def _trend_sd(sampling: Sampling, raw: Repeated, sd_mm: Array, noise: CircleNoise) -> Array:
    """Standard deviation (14,) mm of the trend between laps; empty for a single lap.

    It is that of a lap, derived from that (N,) of the mean, plus the excess in repeated runs over the drift of joints
    and ball. If nothing was measured, this drift is included.
    """
    if not len(sampling.trend):
        return np.empty(0)
    trend, runs = slice(-len(ORDER_OF_TREND), None), len(raw.rows)
    squares = len(sampling.trend) * sd_mm[np.flatnonzero(ORDER_OF < TREND_ORDERS)] ** 2
    scatter = noise.scatter(raw.setup).drifting(raw.response.shape[1])
    drifting: Array = ((raw.drifting[:, trend] * scatter) ** 2).sum(axis=(0, 2))
    if not noise.measured or runs < 2:
        return np.sqrt(squares + drifting)
    apart = raw.deviations_mm[:, trend]
    expected = runs * squares + drifting  # for a single run
    channel = np.arange(len(ORDER_OF_TREND)) * 2 // len(ORDER_OF_TREND)
    alike = channel * TREND_ORDERS + ORDER_OF_TREND
    for number in np.unique(alike).tolist():
        entries = np.flatnonzero(alike == number)
        of_one, freedom = float(expected[entries].mean()), (runs - 1) * len(entries)
        shown = (float((apart[:, entries] ** 2).sum()) + PRIOR_FREEDOM * of_one) / (freedom + PRIOR_FREEDOM)
        squares[entries] += max(shown - of_one, 0.0) / runs
    return np.sqrt(squares)


# ----------------------------------------------------------------------------------------------------------------------
# Simulation of a block about a set-up: readings, derivatives by joints and set-up, and responses to single effects.

_STEP_DEG = 1e-4
"""Step of the derivatives by a joint angle: the tool of a one-metre arm moves by 2 µm, and readings are linear."""
_EARLY, _READING = ("time", "arm"), ("setup", "gauge")
"""Stages of effects before joint errors, and stages with no influence on the tool."""
_RIGID = ("arm", "tool")
"""Stages of effects with columns computed at a healthy size and scaled to the actual size: the tool moves in proportion
to the size, but the fitted ball does not.
"""
_SCENES, _ERRORS = 4, 64
"""Number of scenes, and of joint errors, cached per block, about 0.1 MB each."""
_FEW = 64
"""Number of effects computed together, to fit a processor's cache."""


@dataclass(frozen=True, eq=False)
class SimulatedBlock:
    """Simulated block about a set-up (m readings of k gauges), with the `reference` effects in addition to the rig
    file.
    """

    block: Block
    reference: tuple[Effect, ...]
    setup: SetUp
    _scenes: dict[tuple[Effect, ...], ModelScene] = field(default_factory=dict, init=False, repr=False)
    _errors: dict[tuple[tuple[Effect, ...], Effect], Array] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def scene(self) -> ModelScene:
        return self.scene_with(self.reference)

    @cached_property
    def base(self) -> Array:
        return self.read(self.reference, self.scene, self.setup)

    @cached_property
    def slopes(self) -> Array:
        """Derivatives (axes, m, k) of the readings in mm by the joint errors in rad."""
        slopes = np.empty((self.block.model.arm.axes, *self.base.shape))
        for axis, of_axis in enumerate(slopes, start=1):
            effects = (*self.reference, turned(axis, _STEP_DEG))
            of_axis[:] = self.read(effects, self.scene_with(effects), self.setup) - self.base
        slopes /= np.radians(_STEP_DEG)
        return slopes

    @cached_property
    def by_setup(self) -> Array:
        """Change (N, t) of the whitened readings per mm of each set-up term."""
        steps = STEP_MM * np.eye(self.block.facts.setup_terms)
        setups = [moved_setup(self.setup, self.block.table, step) for step in steps]
        changed = np.stack([self.read(self.reference, self.scene, setup) - self.base for setup in setups], axis=2)
        return self.block.whitened(changed) / STEP_MM

    def scene_with(self, effects: Sequence[Effect]) -> ModelScene:
        """Scene up to the tool with `effects` in place of the reference."""
        model = _with(self.block.model, *effects)
        early = _early(model.effects)
        errors = [self._error(early, effect) for effect in model.effects if effect.STAGE == "joint"]
        joints = self._joints(early)
        return posed(model, self.block.path, replace(joints, link_q=sum(errors, start=joints.link_q)))

    def _joints(self, early: tuple[Effect, ...]) -> ModelScene:
        def compute() -> ModelScene:
            return driven(replace(self.block.model, effects=early), self.block.path)

        return recent(self._scenes, early, compute, _SCENES)

    def _error(self, early: tuple[Effect, ...], effect: Effect) -> Array:
        """Joint errors (n, axes) rad of an effect after those of earlier stages, cached: a fit changes few effects at a
        time.
        """
        joints = self._joints(early)

        def compute() -> Array:
            return apply([effect], "joint", joints).link_q - joints.link_q

        return recent(self._errors, (early, without_origin(effect)), compute, _ERRORS)

    def read(self, effects: Sequence[Effect], scene: ModelScene, setup: SetUp) -> Array:
        return predicted_in_scene(_with(self.block.model, *effects), self.block, scene, setup)

    def by_joint(self, axis: int, off: Array) -> Array:
        return self.block.whitened(self.slopes[axis - 1, :, :, None] * off[self.block.samples, None])

    def retimed(self, effect: Effect) -> Array:
        """Change (N, c + 1) of the whitened readings of a circle if the joint errors of an effect are late by each of c
        stamp effects of healthy size, and if stamps scatter; zero at targets.
        """
        stamps = late_stamps()
        if not self.block.sampling:
            return np.zeros((len(self.block.y_mm), len(stamps) + 1))
        early = _early((*self.block.model.effects, *self.reference))
        joints, now = self._joints(early), self._error(early, effect)
        moment_s = STAMP_SCATTER * float(np.median(np.diff(joints.t_s[self.block.samples])))
        scenes = [joints.taken_at(joints.t_s + way * moment_s) for way in (-1, 1)]
        scattered = sum(apply([effect], "joint", scene).link_q - scene.link_q for scene in scenes) / 2
        errors = [*(self._error((*early, stamp), effect) for stamp in stamps), scattered]
        change = np.stack([(error - now)[self.block.samples] for error in errors], axis=2)
        return self.block.whitened(np.einsum("amk,mac->mkc", self.slopes, change))

    def columns(self, effects: Sequence[Effect]) -> Array:
        """Responses (N, p) of the whitened readings to the effects."""
        early, parts = _early((*self.block.model.effects, *self.reference)), []
        for begin in range(0, len(effects), _FEW):
            few = effects[begin : begin + _FEW]
            added = np.zeros((len(few), *self.base.shape))
            # Most forms are sines of joint angles, which together take a quarter of the time.
            if waves := [k for k, effect in enumerate(few) if is_sine(effect)]:
                axes, order, phase, size = np.array([sine_of(few[k]) for k in waves]).T
                joint = axes.astype(np.int64) - 1
                angles = self._joints(early).q[self.block.samples].T[joint]
                error = size[:, None] * cos_sin(order[:, None] * angles + phase[:, None])[1]
                added[waves] = self.slopes[joint] * error[:, :, None]
            for k, effect in enumerate(few):
                if is_sine(effect):
                    continue
                if effect.STAGE == "joint":
                    error = self._error(early, effect)
                    # For a few rows, a matrix product takes a quarter of the time of numpy's `any` along the axis.
                    for axis in np.flatnonzero(np.ones(len(error)) @ (error != 0)).tolist():
                        added[k] += self.slopes[axis] * error[self.block.samples, axis, None]
                else:
                    times = max(1.0, abs(size_of(effect))) if effect.STAGE in _RIGID else 1.0
                    present = (*self.reference, scaled(effect, 1 / times))
                    scene = self.scene if effect.STAGE in _READING else self.scene_with(present)
                    added[k] = times * (self.read(present, scene, self.setup) - self.base)
            parts.append(self.block.whitened(np.moveaxis(added, 0, 2)))
        return np.concatenate(parts, axis=1)


@dataclass(frozen=True, eq=False)
class SharedBlock(SimulatedBlock):
    """Simulated block shared by several linearisations, caching the columns (N,) of every requested effect."""

    _columns: dict[Effect, Array] = field(default_factory=dict, init=False, repr=False)

    def columns(self, effects: Sequence[Effect]) -> Array:
        new = [effect for effect in dict.fromkeys(effects) if effect not in self._columns]
        if new:
            self._columns.update(zip(new, super().columns(new).T, strict=True))
        return np.stack([self._columns[effect] for effect in effects], axis=1)


def _early(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    return tuple(without_origin(effect) for effect in effects if effect.STAGE in _EARLY)


def _with(model: Model, *effects: Effect) -> Model:
    return replace(model, effects=(*model.effects, *effects))
