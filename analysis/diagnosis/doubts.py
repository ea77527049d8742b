"""Doubts: what a person should know before trusting a diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.blocks import Block
from analysis.diagnosis.observed_run import ObservedRun
from analysis.diagnosis.run_setups import fit_run_setups
from analysis.fitting.observation import rms
from analysis.kinematics.arm import Array
from analysis.noise.cell import TARGET_MM
from analysis.traces.tables import CircleTable, PoseTable
from rigs.rig import Rig
from rigs.schema.effect import name_of

_BETTER = 0.97
"""Ratio of the gap without an effect of the rig file to the gap with it, below which the effect is doubted. Chosen: 3 %
of the rms is more than a refitted set-up gains by chance."""
_SPREADS = 10.0
"""Robust standard deviations from which a reading at a target is wild; they are taken to be at least the largest of
real cells, 0.06 mm. Chosen: as for the sphere of a radial test."""


def doubts_of_runs(blocks: Sequence[Block]) -> tuple[str, ...]:
    """Return what the runs leave open, however well they are explained."""
    doubts = []
    circles = [block for block in blocks if block.sampling]
    if circles and not circles[0].measured:
        doubts.append("no circle was repeated: the noise of real cells is assumed; repeat each circle")
    alone = [block.name for block in circles if block.measured and block.count < 2]
    if alone:
        doubts.append(f"{', '.join(alone)} was driven once: its noise is assumed equal to that of the other circles")
    once = [block.name for block in blocks if not block.sampling and not block.measured]
    if once:
        doubts.append(f"no target of {', '.join(once)} was visited twice: its scatter is assumed; visit targets again")
    ways: dict[str, set[str]] = {}
    for block in blocks:
        table = block.one.table
        if isinstance(table, CircleTable):
            ways.setdefault(table.test, set()).add(table.direction)
    for test, seen in ways.items():
        if len(seen) == 1:
            doubts.append(
                f"{test} was driven {next(iter(seen))} only: effects that change with the direction cannot be detected"
            )
    if not circles:
        doubts.append("no circle was given: effects that depend on speed or on reversals cannot be detected")
    return tuple(doubts)


def doubts_of_targets(blocks: Sequence[Block], left_mm: Sequence[Array]) -> tuple[str, ...]:
    """Return a message for each test at targets with readings far from all others, given what the model leaves of the
    entries of each block, (N,) mm. No effect explains such readings."""
    by_test: dict[str, list[Array]] = {}
    for block, left in zip(blocks, left_mm, strict=True):
        if not block.sampling and not isinstance(block.one.table, PoseTable):
            by_test.setdefault(block.name, []).append(np.abs(left))
    doubts = []
    for name, parts in by_test.items():
        far_mm = np.concatenate(parts)
        wild = far_mm > _SPREADS * max(1.4826 * float(np.median(far_mm)), TARGET_MM.high)
        if wild.any():
            doubts.append(
                f"{wild.sum()} of {len(far_mm)} readings at the targets of {name} (means of repeats) are wild, up to "
                f"{far_mm.max():.1f} mm off: check that the robot stands while it is read, that the clocks agree, "
                "and that the plunger touches"
            )
    return tuple(doubts)


def doubts_of_rig(rig: Rig, runs: Sequence[ObservedRun]) -> tuple[str, ...]:
    """Return a message for each effect of the rig file without which the model fits the readings better."""
    if not rig.effects:
        return ()
    whole = rms(fit_run_setups(runs)[1])
    doubts = []
    for k, effect in enumerate(rig.effects):
        bare = (*rig.effects[:k], *rig.effects[k + 1 :])
        without = rms(fit_run_setups([replace(run, model=replace(run.model, effects=bare)) for run in runs])[1])
        if without < _BETTER * whole:
            doubts.append(
                f"without {name_of(effect)} of the rig file the gap is {1e3 * without:.1f} instead of "
                f"{1e3 * whole:.1f} µm: remove it and diagnose again"
            )
    return tuple(doubts)
