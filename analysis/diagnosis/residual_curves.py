"""Residuals of a model, with set-ups fitted, in the form that plots show: curves of circles and maps of targets."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.diagnosis.blocks import Block
from analysis.diagnosis.diagnosis import Curve, Map
from analysis.diagnosis.observed_run import GRID, curve
from analysis.diagnosis.residual_places import reversals_of
from analysis.geometry.hemisphere import target_angles
from analysis.kinematics.arm import Array
from analysis.traces.tables import CircleTable, PoseTable, test_of


def curves_of(blocks: Sequence[Block], before: Sequence[Array], after: Sequence[Array]) -> tuple[Curve, ...]:
    """Return the curves of the blocks of circles, given the residual (N,) mm of each block before and after."""
    parts = zip(blocks, before, after, strict=True)
    return tuple(_curve(block, b, a) for block, b, a in parts if block.sampling)


def maps_of(blocks: Sequence[Block], before: Sequence[Array], after: Sequence[Array]) -> tuple[Map, ...]:
    """Return the maps of the blocks of targets and poses, given the residual (N,) mm of each block before and after."""
    parts = zip(blocks, before, after, strict=True)
    return tuple(_map(block, b, a) for block, b, a in parts if not block.sampling)


def _curve(block: Block, before: Array, after: Array) -> Curve:
    table = block.one.table
    assert isinstance(table, CircleTable)  # noqa: S101 - blocks with a sampling are circles
    phi = np.arange(GRID) * 360 / GRID
    return Curve(table.test, table.direction, phi, 1e3 * curve(before), 1e3 * curve(after), reversals_of(block))


def _map(block: Block, before: Array, after: Array) -> Map:
    table = block.one.table
    if isinstance(table, PoseTable):
        sizes = [1e3 * np.linalg.norm(values.reshape(-1, 3), axis=1) for values in (before, after)]
        none = np.full(len(sizes[0]), np.nan)
        return Map("pose", np.arange(1.0, len(none) + 1), none, none, *sizes)
    assert not isinstance(table, CircleTable)  # noqa: S101 - circles have a sampling
    hemisphere = block.model.rig.tests.hemisphere
    assert hemisphere is not None  # noqa: S101 - its targets were checked when the run was read
    polar, azimuth = (np.degrees(angles)[table.target - 1] for angles in target_angles(hemisphere))
    return Map(test_of(table), table.target.astype(float), polar, azimuth, 1e3 * before, 1e3 * after)
