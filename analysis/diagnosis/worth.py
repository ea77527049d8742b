"""What a name is worth in µm: by how much it moves readings, what a set-up could take up left out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.blocks import Block
from analysis.diagnosis.linear import Linear
from analysis.diagnosis.observed import GRID, ORDER_OF
from analysis.kinematics.arm import Array
from analysis.traces.tables import PoseTable

LEAST_UM = 3.0
"""Less is not material anywhere: the best gauges of such a link read to that."""


@dataclass(frozen=True)
class Worth:
    """Root mean square in µm, by block, of some change of the readings."""

    um: Array

    @property
    def whole_um(self) -> float:
        """Over all blocks, each counted alike."""
        return float(np.sqrt(np.mean(self.um**2)))

    def is_material(self, limits_um: Array) -> bool:
        """Whether readings of any block move by more than its limit."""
        return bool((self.um > limits_um).any())


def worth(linear: Linear, change: Array) -> Worth:
    """Of a change (N,) of readings in standard deviations, set-ups fitted to it."""
    return plain_worth(linear, linear.set_up(change))


def plain_worth(linear: Linear, change: Array) -> Worth:
    """Of a change (N,) as it is."""
    return Worth(np.array([rms_um(*one) for one in zip(linear.blocks, linear.in_mm(change), strict=True)]))


def limits_um(linear: Linear, tolerance_um: float | None) -> Array:
    """From which change on (b,) a name is material: a person's tolerance, else the scatter of one run."""
    if tolerance_um is not None:
        return np.full(len(linear.blocks), tolerance_um)
    return np.maximum(scatter_um(linear), LEAST_UM)


def scatter_um(linear: Linear) -> Array:
    """How far one run is from the mean of many (b,), rms of its readings, the set-up fitted to it; at targets that of
    a typical one, for a few scatter by many times as much."""
    moved = linear.set_up(linear.Z)
    whole = linear.in_mm(np.sqrt(1 + (moved**2).sum(axis=1)))
    return np.array([
        rms_um(block, np.sqrt(block.count) * (one if block.sampling else np.full(len(one), np.median(one))))
        for block, one in zip(linear.blocks, whole, strict=True)
    ])  # fmt: skip


def rms_um(block: Block, entries_mm: Array) -> float:
    """Root mean square in µm of a block's entries (N,) mm: per reading of a gauge; of poses the distance."""
    if block.sampling:
        energy, count = float((entries_mm[: len(ORDER_OF)] ** 2).sum()), 2 * GRID
    else:
        energy = float((entries_mm**2).sum())
        count = len(entries_mm) // (3 if isinstance(block.one.table, PoseTable) else 1)
    return 1e3 * float(np.sqrt(energy / count))
