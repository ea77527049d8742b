"""The worth of a name in µm: the change of the readings that it causes beyond what a set-up could absorb."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from analysis.diagnosis.blocks import Block
from analysis.diagnosis.linearisation import Linearisation
from analysis.diagnosis.observed_run import GRID, ORDER_OF
from analysis.kinematics.arm import Array
from analysis.traces.tables import PoseTable

LEAST_MATERIAL_UM = 3.0
"""Smallest change that is material anywhere, which is the resolution of the best gauges of such a link."""


@dataclass(frozen=True)
class Worth:
    """Root mean square in µm, by block (b,), of a change of the readings."""

    um: Array

    @property
    def whole_um(self) -> float:
        """The root mean square over all blocks, each with the same weight."""
        return float(np.sqrt(np.mean(self.um**2)))

    def is_material(self, limits_um: Array) -> bool:
        """Return whether the readings of any block change by more than its limit (b,) µm."""
        return bool((self.um > limits_um).any())


def worth(linear: Linearisation, change: Array) -> Worth:
    """Return the worth of a change (N,) of whitened readings, with set-ups fitted to it."""
    return plain_worth(linear, linear.without_set_up(change))


def plain_worth(linear: Linearisation, change: Array) -> Worth:
    """Return the worth of a change (N,) of whitened readings, without fitting set-ups."""
    return Worth(np.array([rms_um(*one) for one in zip(linear.blocks, linear.in_mm(change), strict=True)]))


def limits_um(
    linear: Linearisation, tolerance_um: float | None, own_um: Mapping[str, float] = MappingProxyType({})
) -> Array:
    """Return the changes (b,) µm from which a name is material: the tolerance if given, or else the scatter of one run
    without `own_um`, the part that the name makes in each set-up.

    Few repeats show the scatter of one run within a fifth or worse, so the limit is computed from its mean square less
    the standard uncertainty of that. A single difference of two runs shows no uncertainty.
    """
    if tolerance_um is not None:
        return np.full(len(linear.blocks), tolerance_um)
    own = np.array([own_um.get(block.one.setup, 0.0) for block in linear.blocks])
    squares, relative = _scatter_squares(linear, _steady)
    least = np.maximum((squares - own**2) * (1 - relative), LEAST_MATERIAL_UM**2)
    return np.asarray(np.sqrt(least), dtype=float)


def scatter_um(linear: Linearisation) -> Array:
    """Return the rms difference (b,) µm of one run from the mean of many; at targets that of a median target, because a
    few scatter many times as much. What stamps add where readings change quickly is not counted.

    Repeated circles show it themselves, together in all directions of a set-up; elsewhere it is that of the noise.
    """
    return np.asarray(np.sqrt(_scatter_squares(linear, _steady)[0]), dtype=float)


def noise_um(linear: Linearisation) -> Array:
    """Return the same rms difference (b,) µm with what stamps added to repeated circles."""
    return np.asarray(np.sqrt(_scatter_squares(linear, lambda block: block.apart_mm)[0]), dtype=float)


def _steady(block: Block) -> Array:
    """Return the deviations (n, N) mm of repeated runs without those that stamps make."""
    return block.steady_mm


def _scatter_squares(linear: Linearisation, deviations: Callable[[Block], Array]) -> tuple[Array, Array]:
    """Return the mean square (b,) µm² of the difference of one run from the mean of many, and its relative standard
    uncertainty (b,), which is zero where repeats do not show it."""
    found, relative = _expected_scatter_um(linear) ** 2, np.zeros(len(linear.blocks))
    repeated = [k for k, block in enumerate(linear.blocks) if block.sampling and deviations(block).any()]
    for setup in {linear.blocks[k].one.setup for k in repeated}:
        own = [k for k in repeated if linear.blocks[k].one.setup == setup]
        shown = np.concatenate([_shown_squares(linear.blocks[k], deviations(linear.blocks[k])) for k in own])
        found[own] = shown.mean()
        if len(shown) > 1:
            relative[own] = min(1.0, float(shown.std(ddof=1)) / np.sqrt(len(shown)) / float(shown.mean()))
    return found, relative


def _shown_squares(block: Block, apart_mm: Array) -> Array:
    """Return the mean squares (n - 1,) µm² of the independent differences of n repeated runs, given their deviations
    (n, N) mm from their mean."""
    contrasts = np.linalg.svd(np.ones((1, len(apart_mm))))[2][1:]
    return np.array([rms_um(block, one) ** 2 for one in contrasts @ apart_mm])


def _expected_scatter_um(linear: Linearisation) -> Array:
    """Return the rms difference (b,) µm of a run from the mean of many that noise and scatter make, with the set-up
    fitted to it."""
    moved = linear.without_set_up(linear.Z)
    whole = linear.in_mm(np.sqrt(1 + (moved**2).sum(axis=1)))
    return np.array([
        rms_um(block, np.sqrt(block.count) * (one if block.sampling else np.full(len(one), np.median(one))))
        for block, one in zip(linear.blocks, whole, strict=True)
    ])  # fmt: skip


def rms_um(block: Block, entries_mm: Array) -> float:
    """Return the root mean square in µm of a block's entries (N,) mm: per reading of a gauge, and per distance of
    poses."""
    if block.sampling:
        energy, count = float((entries_mm[: len(ORDER_OF)] ** 2).sum()), 2 * GRID
    else:
        energy = float((entries_mm**2).sum())
        count = len(entries_mm) // (3 if isinstance(block.one.table, PoseTable) else 1)
    return 1e3 * float(np.sqrt(energy / count))
