"""What effects add to the whitened residuals of blocks: one by one as columns, or all at once by the simulator.

Set-up terms are projected out of columns: no name is given for what a ball or a zero could do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnose.blocks import Block
from analysis.effects import apply, module_of
from analysis.kinematics.arm import Array
from analysis.model.predict import Model, SetUp, moved, predict
from analysis.reading.tables import PoseTable
from rigs.effects import Effect, JointOffset

_STEP_DEG = 1e-4
_STEP_MM = 0.01


class Linear:
    """Blocks about their models and set-ups: their residual y (N,), what effects add to it, and what set-ups can do."""

    def __init__(self, blocks: Sequence[Block], setups: Mapping[str, SetUp]) -> None:
        self.blocks, self.setups = tuple(blocks), dict(setups)
        self._base = [readings(block.model, block, setups[block.one.setup]) for block in blocks]
        self._scenes = [moved(block.model, block.one.path) for block in blocks]
        self._slopes = [self._slope(block, base) for block, base in zip(blocks, self._base, strict=True)]
        self.nudges = [
            (name, term) for name in self._placed() for term in range(terms_of(setups[name], self.poses(name)))
        ]
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

    def residual(self, effects: Sequence[Effect], setups: Mapping[str, SetUp]) -> Array:
        """What effects, all in the simulator together, and set-ups leave: (N,), nothing projected out."""
        return np.concatenate([self._left(k, effects, setups) for k in range(len(self.blocks))])

    def poses(self, setup: str) -> bool:
        """Whether a set-up is that of a pose instrument."""
        return any(isinstance(block.one.table, PoseTable) for block in self.blocks if block.one.setup == setup)

    def added_mm(self, k: int, effects: Sequence[Effect], setups: Mapping[str, SetUp]) -> Array:
        """What effects, all together, and set-ups add to the readings (m, k) mm of one block."""
        block = self.blocks[k]
        return readings(_with(block.model, *effects), block, setups[block.one.setup]) - self._base[k]

    def jolt(self, k: int, axis: int, sample: int, angle_deg: float) -> Array:
        """What one joint (1 … 6), off at one sample of one block's path alone, adds: (N,), nothing projected out."""
        block = self.blocks[k]
        rows = block.one.path.rows[block.one.rows]
        added = self._slopes[k][:, :, axis - 1] * (np.radians(angle_deg) * (rows == sample))[:, None]
        begin = sum(len(other.y) for other in self.blocks[:k])
        whole = np.zeros(len(self.y))
        whole[begin : begin + len(block.y)] = block.whitened(added)
        return whole

    def _left(self, k: int, effects: Sequence[Effect], setups: Mapping[str, SetUp]) -> Array:
        left: Array = self.blocks[k].y - self.blocks[k].whitened(self.added_mm(k, effects, setups))
        return left

    def _added(self, k: int, effects: Sequence[Effect]) -> Array:
        block, scene, base = self.blocks[k], self._scenes[k], self._base[k]
        rows = block.one.path.rows[block.one.rows]
        added = np.empty((*base.shape, len(effects)))
        for place, effect in enumerate(effects):
            if module_of(effect).STAGE == "joint":
                turned = apply([effect], "joint", scene).link_q[rows] - scene.link_q[rows]
                axis = int(np.argmax(np.abs(turned).max(axis=0)))
                added[:, :, place] = self._slopes[k][:, :, axis] * turned[:, axis, None]
            else:
                grown = _with(block.model, effect)
                added[:, :, place] = readings(grown, block, self.setups[block.one.setup]) - base
        return block.whitened(added)

    def _slope(self, block: Block, base: Array) -> Array:
        slopes = np.empty((*base.shape, 6))
        for axis in range(1, 7):
            nudge = JointOffset(axis=axis, offset_deg=_STEP_DEG)
            read = readings(_with(block.model, nudge), block, self.setups[block.one.setup])
            slopes[:, :, axis - 1] = (read - base) / np.radians(_STEP_DEG)
        return slopes

    def _placed(self) -> list[str]:
        """Set-ups that some block has."""
        return list(dict.fromkeys(block.one.setup for block in self.blocks))

    def setup_columns(self, effects: Sequence[Effect], setups: Mapping[str, SetUp]) -> Array:
        """What each term of the set-ups adds per mm, (N, s), about a model with effects."""
        columns = np.zeros((sum(len(block.y) for block in self.blocks), len(self.nudges)))
        begin = 0
        for block in self.blocks:
            rows = slice(begin, begin + len(block.y))
            begin += len(block.y)
            model, name = _with(block.model, *effects), block.one.setup
            base = readings(model, block, setups[name])
            for k, (owner, term) in enumerate(self.nudges):
                if owner == name:
                    changed = nudged(setups[name], self.poses(name), term, _STEP_MM)
                    columns[rows, k] = block.whitened(readings(model, block, changed) - base) / _STEP_MM
        return columns


def _with(model: Model, *effects: Effect) -> Model:
    return replace(model, effects=(*model.effects, *effects))


def basis_of(columns: Array) -> Array:
    """An orthonormal basis of columns (N, s)."""
    norms = np.linalg.norm(columns, axis=0)
    basis, _ = np.linalg.qr(columns[:, norms > 1e-6] / norms[norms > 1e-6])
    return np.asarray(basis, dtype=float)


def terms_of(setup: SetUp, poses: bool) -> int:
    """How many unknowns a set-up has: ball and zeros; for poses the instrument's place and turn, and the target's."""
    return 9 if poses else 3 + len(setup.zeros_mm)


def nudged(setup: SetUp, poses: bool, term: int, step: float) -> SetUp:
    """The set-up with one of its terms changed, by mm (turns of an instrument by rad per 100 mm)."""
    from analysis.fitting.rigid import moved_by  # noqa: PLC0415 - loads scipy

    unit = step * np.eye(3)
    if not poses:
        if term < 3:
            return replace(setup, ball=setup.ball + unit[term])
        return replace(setup, zeros_mm=setup.zeros_mm + step * np.eye(len(setup.zeros_mm))[term - 3])
    zero = np.zeros(3)
    if term < 3:
        return replace(setup, T_instrument_world=moved_by(setup.T_instrument_world, unit[term], zero))
    if term < 6:
        return replace(setup, T_instrument_world=moved_by(setup.T_instrument_world, zero, unit[term - 3] / 100))
    return replace(setup, T_tool_target=moved_by(setup.T_tool_target, unit[term - 6], zero))


def readings(model: Model, block: Block, setup: SetUp) -> Array:
    """What a model predicts for a block's rows, (m, k) mm."""
    one = block.one
    values = predict(model, one.table, one.path, setup)
    if isinstance(one.table, PoseTable):
        values = values[:, [3, 7, 11]]
    return values[one.rows]
