"""One block about a set-up on the simulator: its readings, their slopes by joints and by the set-up, and what effects
add to them, one by one as columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from analysis.diagnosis.blocks import Block, entries
from analysis.diagnosis.observed_run import STAMP_SCATTER
from analysis.diagnosis.recent import recent
from analysis.fitting.observation import predicted_in_scene
from analysis.fitting.setups import moved_setup, terms_of
from analysis.kinematics.arm import Array
from analysis.model.predict import Model, SetUp, driven, posed
from analysis.model.scene import Scene, apply
from rigs.effects import Effect, late_stamps, turned
from rigs.schema.effect import scaled, size_of

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
        """The derivatives (m, k, 6) of the readings in mm by the errors of the joints in rad."""
        slopes = np.empty((*self.base.shape, 6))
        for axis in range(1, 7):
            effects = (*self.known, turned(axis, _STEP_DEG))
            slopes[:, :, axis - 1] = self.read(effects, self.scene_with(effects), self.setup) - self.base
        slopes /= np.radians(_STEP_DEG)
        return slopes

    @cached_property
    def by_setup(self) -> Array:
        """The change (N, t) of the whitened readings for a mm of each term of the set-up."""
        steps = _STEP_MM * np.eye(terms_of(self.block.one.table))
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
        model, path = replace(self.block.model, effects=early), self.block.one.path
        return recent(self._scenes, early, lambda: driven(model, path), _SCENES)

    def _error(self, early: tuple[Effect, ...], effect: Effect) -> Array:
        """Return the errors (n, 6) rad of the joints that one effect makes after those of earlier stages. They are
        kept, because errors of joints add and a fit changes few effects at a time."""
        joints = self._joints(early)

        def compute() -> Array:
            error: Array = apply([effect], "joint", joints).link_q - joints.link_q
            return error

        return recent(self._errors, (early, _without_origin(effect)), compute, _ERRORS)

    def read(self, effects: Sequence[Effect], scene: Scene, setup: SetUp) -> Array:
        """Return the readings (m, k) mm of a scene up to the tool."""
        return predicted_in_scene(_with(self.block.model, *effects), self.block.one, scene, setup)

    def at_readings(self, values: Array) -> Array:
        """Return values (n, …) at the samples of the path, in any unit, at the readings, (m, …)."""
        found: Array = values[self.block.one.samples]
        return found

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
        change = np.stack([self.at_readings(one - now) for one in later], axis=2)
        return self.whitened(np.einsum("mka,mac->mkc", self.slopes, change))

    def scattered(self, effect: Effect) -> Array:
        """Return the change (N, 1) of the whitened readings of a circle if the errors of joints that an effect makes
        are on average those of a moment earlier and a moment later, as with stamps that scatter; zero at targets."""
        if not self.block.sampling:
            return np.zeros((len(self.block.y_mm), 1))
        early = _early((*self.block.model.effects, *self.known))
        moved = recent(self._moved, early, lambda: self._moment_apart(self._joints(early)), _SCENES)
        earlier, later = (apply([effect], "joint", one).link_q - one.link_q for one in moved)
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
        return np.concatenate([self.whitened(self._added_by(some)) for some in few], axis=1)

    def _added_by(self, effects: Sequence[Effect]) -> Array:
        """Return what each effect adds to the readings, (m, k, p) mm."""
        early, added = _early((*self.block.model.effects, *self.known)), np.zeros((*self.base.shape, len(effects)))
        for k, effect in enumerate(effects):
            if effect.STAGE == "joint":
                error = self._error(early, effect)
                for axis in _turned_axes(error):
                    added[:, :, k] += self.slopes[:, :, axis] * self.at_readings(error[:, axis])[:, None]
            else:
                times = max(1.0, abs(size_of(effect))) if effect.STAGE in _RIGID else 1.0
                beside = (*self.known, scaled(effect, 1 / times))
                scene = self.scene if effect.STAGE in _READING else self.scene_with(beside)
                added[:, :, k] = times * (self.read(beside, scene, self.setup) - self.base)
        return added


def _turned_axes(error: Array) -> list[int]:
    """Return the numbers (0 … 5) of the joints that have errors among (n, 6) rad. A product of few rows takes a quarter
    of the time that numpy's `any` takes along many short ones."""
    return np.flatnonzero(np.ones(len(error)) @ (error != 0)).tolist()


def _early(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """Return the effects of the stages before that of the joints."""
    return tuple(_without_origin(effect) for effect in effects if effect.STAGE in _EARLY)


def _without_origin(effect: Effect) -> Effect:
    """Return the effect without its origin, which changes no reading and has no hash."""
    return effect if effect.found is None else effect.model_copy(update={"found": None})


def _with(model: Model, *effects: Effect) -> Model:
    return replace(model, effects=(*model.effects, *effects))
