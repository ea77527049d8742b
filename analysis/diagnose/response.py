"""What effects add to the whitened residuals, fast enough to search with.

Effects of the joints go through the derivatives of the readings by the six link-side angles, which are the same for all
of them; the others through the simulator. Set-up terms are projected out of everything: no name is given for what a
ball or a zero could do. Responses of several effects add, which holds for errors that are small against the circle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnose.blocks import Block
from analysis.effects import apply, module_of
from analysis.fitting.estimate import Fit
from analysis.kinematics.arm import Array
from analysis.model.predict import Model, SetUp, moved, predict
from analysis.reading.tables import PoseTable
from rigs.effects import Effect, JointOffset

_STEP_DEG = 0.01
_SETUP_STEP = 0.01


class Response:
    """Blocks about one model: their residual y (N,), and what effects add to it."""

    def __init__(self, model: Model, blocks: Sequence[Block], fitted: Fit) -> None:
        self.model, self.blocks, self.fitted = model, blocks, fitted
        self._base = [_readings(model, block, fitted.setups[block.one.setup]) for block in blocks]
        self._scenes = [moved(model, block.one.path) for block in blocks]
        self._slopes = [self._slope(block, base) for block, base in zip(blocks, self._base, strict=True)]
        self._basis, _ = np.linalg.qr(self._setup_columns())
        self.y = self._projected(np.concatenate([block.y for block in blocks]))

    def of(self, effects: Sequence[Effect]) -> Array:
        """What each effect alone adds, (N, p) in standard deviations, set-up terms projected out."""
        if not effects:
            return np.empty((len(self.y), 0))
        return self._projected(np.concatenate([self._added(k, effects) for k in range(len(self.blocks))]))

    def own(self, effects: Sequence[Effect]) -> Array:
        """Share (p,) of what each effect does that no set-up term could do as well; 0 for one that does nothing."""
        whole = np.concatenate([self._added(k, effects) for k in range(len(self.blocks))])
        size = np.linalg.norm(whole, axis=0)
        left = np.linalg.norm(self._projected(whole), axis=0)
        share: Array = np.divide(left, size, out=np.zeros_like(left), where=size > 1e-9)
        return share

    def _projected(self, columns: Array) -> Array:
        return columns - self._basis @ (self._basis.T @ columns)

    def _added(self, k: int, effects: Sequence[Effect]) -> Array:
        block, scene, base = self.blocks[k], self._scenes[k], self._base[k]
        rows = block.one.path.rows[block.one.rows]
        columns = np.empty((*base.shape, len(effects)))
        for place, effect in enumerate(effects):
            if module_of(effect).STAGE == "joint":
                turned = apply([effect], "joint", scene).link_q - scene.link_q
                columns[:, :, place] = np.einsum("mkj,mj->mk", self._slopes[k], turned[rows])
            else:
                added = replace(self.model, effects=(*self.model.effects, effect))
                columns[:, :, place] = _readings(added, block, self.fitted.setups[block.one.setup]) - base
        return block.whitened(columns)

    def _slope(self, block: Block, base: Array) -> Array:
        slopes = np.empty((*base.shape, 6))
        for axis in range(1, 7):
            nudge = JointOffset(axis=axis, offset_deg=_STEP_DEG)
            nudged = replace(self.model, effects=(*self.model.effects, nudge))
            read = _readings(nudged, block, self.fitted.setups[block.one.setup])
            slopes[:, :, axis - 1] = (read - base) / np.radians(_STEP_DEG)
        return slopes

    def _setup_columns(self) -> Array:
        columns = []
        for name, setup in self.fitted.setups.items():
            poses = any(isinstance(b.one.table, PoseTable) for b in self.blocks if b.one.setup == name)
            for changed in _nudges(setup, poses):
                parts = [
                    block.whitened(_readings(self.model, block, changed) - base)
                    if block.one.setup == name
                    else np.zeros(len(block.y))
                    for block, base in zip(self.blocks, self._base, strict=True)
                ]
                columns.append(np.concatenate(parts))
        scaled = np.stack(columns, axis=1)
        norms = np.linalg.norm(scaled, axis=0)
        kept: Array = scaled[:, norms > 1e-9] / norms[norms > 1e-9]
        return kept


def _nudges(setup: SetUp, poses: bool) -> list[SetUp]:
    """The set-up with each of its terms changed a little."""
    from analysis.fitting.rigid import moved_by  # noqa: PLC0415 - loads scipy

    unit = _SETUP_STEP * np.eye(3)
    if poses:
        zero = np.zeros(3)
        changed = [replace(setup, T_instrument_world=moved_by(setup.T_instrument_world, step, zero)) for step in unit]
        changed += [
            replace(setup, T_instrument_world=moved_by(setup.T_instrument_world, zero, step / 100)) for step in unit
        ]
        return changed + [replace(setup, T_tool_target=moved_by(setup.T_tool_target, step, zero)) for step in unit]
    changed = [replace(setup, ball=setup.ball + step) for step in unit]
    zeros = _SETUP_STEP * np.eye(len(setup.zeros_mm))
    return changed + [replace(setup, zeros_mm=setup.zeros_mm + step) for step in zeros]


def _readings(model: Model, block: Block, setup: SetUp) -> Array:
    one = block.one
    values = predict(model, one.table, one.path, setup)
    if isinstance(one.table, PoseTable):
        values = values[:, [3, 7, 11]]
    return values[one.rows]
