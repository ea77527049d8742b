"""The linearisation: what effects add to the residuals of blocks, in standard deviations of the noise, either one by
one as columns or all together on the simulator."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property

import numpy as np

from analysis.diagnosis.blocks import Block, entries
from analysis.fitting.observation import predicted, predicted_in_scene
from analysis.fitting.setups import columns_of, moved_setup
from analysis.kinematics.arm import Array
from analysis.model.predict import Model, SetUp, moved
from analysis.model.scene import apply
from rigs.effects import Effect, turned

_STEP_DEG = 1e-4
"""Step of the derivatives by a joint angle. Readings are linear over such a step, which moves the tool of an arm of one
metre by 2 µm, and far from the limits of floating-point arithmetic."""
_STEP_MM = 0.01
"""Step of the derivatives by a set-up term. Readings are linear over such a step."""
_INDISTINCT = 0.005
"""Singular value of a combination of set-up terms, as a share of the largest, below which it is not moved. A ball along
the normal of its circle shows a thousandth of what it shows across, so other errors would move it by metres; the ball
of a hemisphere shows a hundredth along its weakest direction, with fewer readings."""
_READING = ("setup", "gauge")
"""Stages of effects that do not move the tool."""


class Linearisation:
    """Blocks about a model and its set-ups; N counts the entries of all blocks, in standard deviations of the noise.

    `known` lists the effects found so far, which the model contains beside those of its rig file. `y` (N,) is the
    residual with them; `U` (N, s) is the change for a mm of each set-up term; `Z` (N, c) is the change for one standard
    deviation of the scatter between runs; `band` (N,) numbers the bands.
    """

    def __init__(self, blocks: Sequence[Block], setups: Mapping[str, SetUp], known: Sequence[Effect] = ()) -> None:
        self.blocks, self.setups, self.known = tuple(blocks), dict(setups), tuple(known)
        self._scenes = [moved(_with(block.model, *known), block.one.path) for block in blocks]
        self._base = [
            predicted_in_scene(_with(block.model, *known), block.one, scene, setups[block.one.setup])
            for block, scene in zip(blocks, self._scenes, strict=True)
        ]
        self._slopes = [self._slope(block, base) for block, base in zip(blocks, self._base, strict=True)]
        self._tables = {block.one.setup: block.one.table for block in blocks}
        self.terms = columns_of(self._tables)
        sizes = [len(block.y_mm) for block in blocks]
        self.rows = [slice(end - size, end) for size, end in zip(sizes, np.cumsum(sizes).tolist(), strict=True)]
        self.y = np.concatenate([block.white(block.y_mm) for block in blocks])
        self.U = self._setup_columns()
        self.Z = self._scatter_columns()
        self.band = np.concatenate([block.band for block in blocks])

    @cached_property
    def _best_moves(self) -> Array:
        """The terms of the set-ups (s, N) mm that fit whitened readings best."""
        found: Array = np.asarray(np.linalg.pinv(self.U, rcond=_INDISTINCT), dtype=float)
        return found

    def columns(self, effects: Sequence[Effect]) -> Array:
        """Return what each effect adds to the whitened readings, (N, p)."""
        if not effects:
            return np.empty((len(self.y), 0))
        return np.concatenate([self._added(k, effects) for k in range(len(self.blocks))])

    def residual(self, effects: Sequence[Effect]) -> Array:
        """Return the whitened residual (N,) with `effects` in place of the known ones, all of them on the simulator
        together.

        A large effect moves the ball by a millimetre, over which readings are not linear. So they are simulated where
        the set-ups fit best with these effects, and taken back to the set-ups of this linearisation along their slopes.
        """
        responses = [self.response_of(k, effects) for k in range(len(self.blocks))]
        moved = self._best_moves @ self._left(responses, self.setups)
        return self._left(responses, self.setups_moved_by(moved)) + self.U @ moved

    def residual_at(self, effects: Sequence[Effect], setups: Mapping[str, SetUp]) -> Array:
        """Return the whitened residual (N,) with `effects` in place of the known ones in given set-ups."""
        return self._left([self.response_of(k, effects) for k in range(len(self.blocks))], setups)

    def _left(self, responses: Sequence[Callable[[Mapping[str, SetUp]], Array]], setups: Mapping[str, SetUp]) -> Array:
        """Return the whitened residual (N,) of the responses of all blocks in given set-ups."""
        return np.concatenate([
            block.white(block.y_mm) - block.whitened(response(setups))
            for block, response in zip(self.blocks, responses, strict=True)
        ])  # fmt: skip

    def simulated_with(self, effects: Sequence[Effect]) -> Linearisation:
        """Return the linearisation of the same runs with readings simulated with `effects` in place of the known ones
        and without noise; y is (N,)."""
        other = copy(self)
        other.blocks = tuple(
            replace(block, y_mm=entries(self.response_of(k, effects)(self.setups), block.sampling))
            for k, block in enumerate(self.blocks)
        )
        other.y = np.concatenate([block.white(block.y_mm) for block in other.blocks])
        return other

    def without_set_up(self, values: Array) -> Array:
        """Return whitened values (N, …) with the part removed that set-ups could absorb."""
        basis = basis_of(self.U)
        fitted: Array = values - basis @ (basis.T @ values)
        return fitted

    def setups_moved_by(self, moved: Array) -> dict[str, SetUp]:
        """Return the set-ups with their terms moved by (s,) mm."""
        return {
            name: moved_setup(self.setups[name], table, moved[self.terms[name]]) for name, table in self._tables.items()
        }

    def response_of(self, k: int, effects: Sequence[Effect]) -> Callable[[Mapping[str, SetUp]], Array]:
        """Return a function of the set-ups that gives what `effects`, in place of the known ones, add to the readings
        (m, k) mm of one block."""
        one, model, base = self.blocks[k].one, _with(self.blocks[k].model, *effects), self._base[k]
        scene = moved(model, one.path)
        return lambda setups: predicted_in_scene(model, one, scene, setups[one.setup]) - base

    def in_mm(self, left: Array) -> list[Array]:
        """Return whitened values (N,) as the entries of each block in mm."""
        return [left[rows] * block.sd_mm for rows, block in zip(self.rows, self.blocks, strict=True)]

    def by_joint(self, axis: int, off: Callable[[Block], Array]) -> Array:
        """Return the change (N, c) of the whitened readings for errors (n, c) rad of a joint (1 … 6) at the samples of
        each block's path."""
        return np.concatenate(
            [
                block.whitened(slopes[:, :, axis - 1, None] * off(block)[block.one.path.rows[block.one.rows], None])
                for block, slopes in zip(self.blocks, self._slopes, strict=True)
            ]
        )

    def by_gauge(self, shares: Sequence[float], off: Callable[[Block], Array]) -> Array:
        """Return the change (N, c) of the whitened readings for errors of the gauges: `shares` (2,) times (n, c) mm at
        the samples of each circle's path, and zero for other tests."""
        parts = []
        for block, base in zip(self.blocks, self._base, strict=True):
            each = np.array(shares) if block.sampling else np.zeros(base.shape[1])
            parts.append(block.whitened(each[:, None] * off(block)[block.one.path.rows[block.one.rows], None]))
        return np.concatenate(parts)

    def jolt(self, k: int, axis: int, sample: int, angle_deg: float) -> Array:
        """Return the change (N,) of the whitened readings for an error of one joint (1 … 6) at a single sample of one
        block's path."""
        block = self.blocks[k]
        rows = block.one.path.rows[block.one.rows]
        added = self._slopes[k][:, :, axis - 1] * (np.radians(angle_deg) * (rows == sample))[:, None]
        whole = np.zeros(len(self.y))
        whole[self.rows[k]] = block.whitened(added)
        return whole

    def _added(self, k: int, effects: Sequence[Effect]) -> Array:
        block, scene, base = self.blocks[k], self._scenes[k], self._base[k]
        rows = block.one.path.rows[block.one.rows]
        added = np.empty((*base.shape, len(effects)))
        for place, effect in enumerate(effects):
            if effect.STAGE == "joint":
                off = apply([effect], "joint", scene).link_q[rows] - scene.link_q[rows]
                added[:, :, place] = np.einsum("mkj,mj->mk", self._slopes[k], off)
            else:
                extended = _with(block.model, *self.known, effect)
                there = scene if effect.STAGE in _READING else moved(extended, block.one.path)
                added[:, :, place] = predicted_in_scene(extended, block.one, there, self.setups[block.one.setup]) - base
        return block.whitened(added)

    def _slope(self, block: Block, base: Array) -> Array:
        slopes = np.empty((*base.shape, 6))
        for axis in range(1, 7):
            read = predicted(
                _with(block.model, *self.known, turned(axis, _STEP_DEG)), block.one, self.setups[block.one.setup]
            )
            slopes[:, :, axis - 1] = (read - base) / np.radians(_STEP_DEG)
        return slopes

    def _setup_columns(self) -> Array:
        columns = np.zeros((len(self.y), 1 + max(map(max, self.terms.values()))))
        for block, rows, scene, base in zip(self.blocks, self.rows, self._scenes, self._base, strict=True):
            model, setup = _with(block.model, *self.known), self.setups[block.one.setup]
            terms = self.terms[block.one.setup]
            for k, step in zip(terms, _STEP_MM * np.eye(len(terms)), strict=True):
                changed = predicted_in_scene(model, block.one, scene, moved_setup(setup, block.one.table, step))
                columns[rows, k] = block.whitened(changed - base) / _STEP_MM
        return columns

    def _scatter_columns(self) -> Array:
        ends = np.cumsum([0, *(block.scatter_mm.shape[1] for block in self.blocks)])
        columns = np.zeros((len(self.y), int(ends[-1])))
        for block, rows, begin, end in zip(self.blocks, self.rows, ends, ends[1:], strict=False):
            columns[rows, begin:end] = block.white(block.scatter_mm)
        return columns


def basis_of(columns: Array) -> Array:
    """Return an orthonormal basis (N, r) of columns (N, s), of which those equal to zero are ignored."""
    basis, _ = np.linalg.qr(columns[:, np.linalg.norm(columns, axis=0) > 0])
    return np.asarray(basis, dtype=float)


def _with(model: Model, *effects: Effect) -> Model:
    return replace(model, effects=(*model.effects, *effects))
