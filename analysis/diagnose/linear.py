"""What effects add to the whitened residuals of blocks: one by one as columns, or all at once by the simulator.

Set-up terms are projected out of columns: no name is given for what a ball or a zero could do.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from analysis.diagnose.blocks import Block
from analysis.fitting.observation import predicted, seen
from analysis.fitting.setups import moved_setup, terms_of
from analysis.kinematics.arm import Array
from analysis.model.predict import Model, SetUp, moved
from analysis.model.scene import apply
from rigs.effects import Effect, turned

_STEP_DEG = 1e-4
_STEP_MM = 0.01
_READING = ("setup", "gauge")
"""Stages that leave the tool where it is."""


class Linear:
    """Blocks about their models and set-ups: their residual y (N,), what effects add to it, and what set-ups can do."""

    def __init__(self, blocks: Sequence[Block], setups: Mapping[str, SetUp]) -> None:
        self.blocks, self.setups = tuple(blocks), dict(setups)
        self._scenes = [moved(block.model, block.one.path) for block in blocks]
        self._base = [
            seen(block.model, block.one, scene, setups[block.one.setup])
            for block, scene in zip(blocks, self._scenes, strict=True)
        ]
        self._slopes = [self._slope(block, base) for block, base in zip(blocks, self._base, strict=True)]
        self._tables = {block.one.setup: block.one.table for block in blocks}
        counts = [terms_of(table) for table in self._tables.values()]
        ends = np.cumsum(counts).tolist()
        self.terms = {
            name: slice(end - count, end) for name, end, count in zip(self._tables, ends, counts, strict=True)
        }
        self.U = self.setup_columns((), self.setups)
        self._basis = basis_of(self.U)
        self.y = self.projected(np.concatenate([block.y for block in blocks]))

    def columns(self, effects: Sequence[Effect]) -> Array:
        """What each effect alone adds, (N, p) in standard deviations, set-up terms projected out."""
        return self.projected(self.raw(effects))

    def raw(self, effects: Sequence[Effect]) -> Array:
        """The same with what set-up terms could do."""
        if not effects:
            return np.empty((len(self.y), 0))
        return np.concatenate([self._added(k, effects) for k in range(len(self.blocks))])

    def projected(self, columns: Array) -> Array:
        """Columns without what set-up terms can do."""
        return columns - self._basis @ (self._basis.T @ columns)

    def leaving(self, effects: Sequence[Effect]) -> Callable[[Mapping[str, SetUp]], Array]:
        """What effects, all in the simulator together, and set-ups leave: (N,) by set-ups, nothing projected out."""
        added = [self.adding(k, effects) for k in range(len(self.blocks))]
        return lambda setups: np.concatenate([
            block.y - block.whitened(of(setups)) for block, of in zip(self.blocks, added, strict=True)
        ])  # fmt: skip

    @property
    def stands(self) -> NDArray[np.bool_]:
        """Which terms of the set-ups say where a ball, or an instrument, stands, (s,)."""
        return np.concatenate([np.arange(terms_of(table)) < 3 for table in self._tables.values()])

    def placed(self, moved: Array) -> dict[str, SetUp]:
        """The set-ups with their terms moved by (s,) mm."""
        return {
            name: moved_setup(self.setups[name], table, moved[self.terms[name]]) for name, table in self._tables.items()
        }

    def adding(self, k: int, effects: Sequence[Effect]) -> Callable[[Mapping[str, SetUp]], Array]:
        """What effects, all together, and set-ups add to the readings (m, k) mm of one block, by set-ups."""
        one, model, base = self.blocks[k].one, _with(self.blocks[k].model, *effects), self._base[k]
        scene = moved(model, one.path)
        return lambda setups: seen(model, one, scene, setups[one.setup]) - base

    def in_mm(self, left: Array) -> list[Array]:
        """What is left (N,) in standard deviations as each block's entries in mm: less what set-up and scatter can
        do."""
        ends = np.cumsum([len(block.y) for block in self.blocks])
        return [part * block.sd_mm for part, block in zip(np.split(left, ends[:-1]), self.blocks, strict=True)]

    def by_joint(self, axis: int, off: Callable[[Block], Array]) -> Array:
        """What a joint (1 … 6) adds that is off by (n, c) rad at the samples of each block's path: (N, c), nothing
        projected out."""
        return np.concatenate(
            [
                block.whitened(slopes[:, :, axis - 1, None] * off(block)[block.one.path.rows[block.one.rows], None])
                for block, slopes in zip(self.blocks, self._slopes, strict=True)
            ]
        )

    def by_gauge(self, shares: Sequence[float], off: Callable[[Block], Array]) -> Array:
        """What gauges add that are off by shares (2,) of (n, c) mm at the samples of each circle's path: (N, c),
        nothing projected out; elsewhere nothing."""
        parts = []
        for block, base in zip(self.blocks, self._base, strict=True):
            each = np.array(shares) if block.sampling else np.zeros(base.shape[1])
            parts.append(block.whitened(each[:, None] * off(block)[block.one.path.rows[block.one.rows], None]))
        return np.concatenate(parts)

    def jolt(self, k: int, axis: int, sample: int, angle_deg: float) -> Array:
        """What one joint (1 … 6), off at one sample of one block's path alone, adds: (N,), nothing projected out."""
        block = self.blocks[k]
        rows = block.one.path.rows[block.one.rows]
        added = self._slopes[k][:, :, axis - 1] * (np.radians(angle_deg) * (rows == sample))[:, None]
        begin = sum(len(other.y) for other in self.blocks[:k])
        whole = np.zeros(len(self.y))
        whole[begin : begin + len(block.y)] = block.whitened(added)
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
                grown = _with(block.model, effect)
                there = scene if effect.STAGE in _READING else moved(grown, block.one.path)
                added[:, :, place] = seen(grown, block.one, there, self.setups[block.one.setup]) - base
        return block.whitened(added)

    def _slope(self, block: Block, base: Array) -> Array:
        slopes = np.empty((*base.shape, 6))
        for axis in range(1, 7):
            read = predicted(_with(block.model, turned(axis, _STEP_DEG)), block.one, self.setups[block.one.setup])
            slopes[:, :, axis - 1] = (read - base) / np.radians(_STEP_DEG)
        return slopes

    def setup_columns(self, effects: Sequence[Effect], setups: Mapping[str, SetUp]) -> Array:
        """What each term of the set-ups adds per mm, (N, s), about a model with effects."""
        columns = np.zeros((sum(len(block.y) for block in self.blocks), len(self.stands)))
        begin = 0
        for block in self.blocks:
            rows = slice(begin, begin + len(block.y))
            begin += len(block.y)
            model, setup = _with(block.model, *effects), setups[block.one.setup]
            scene = moved(model, block.one.path)
            base = seen(model, block.one, scene, setup)
            terms = self.terms[block.one.setup]
            for k, step in enumerate(_STEP_MM * np.eye(terms.stop - terms.start), start=terms.start):
                changed = seen(model, block.one, scene, moved_setup(setup, block.one.table, step))
                columns[rows, k] = block.whitened(changed - base) / _STEP_MM
        return columns


def _with(model: Model, *effects: Effect) -> Model:
    return replace(model, effects=(*model.effects, *effects))


def basis_of(columns: Array) -> Array:
    """An orthonormal basis of columns (N, s)."""
    norms = np.linalg.norm(columns, axis=0)
    basis, _ = np.linalg.qr(columns[:, norms > 1e-6] / norms[norms > 1e-6])
    return np.asarray(basis, dtype=float)
