"""Doubts: what a person should know before trusting a diagnosis."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from analysis.diagnosis.blocks import Block
from analysis.diagnosis.diagnosis import Named
from analysis.diagnosis.observed_run import ObservedRun
from analysis.diagnosis.refine import size_limits
from analysis.diagnosis.run_setups import fit_run_setups
from analysis.fitting.observation import rms
from analysis.traces.tables import CircleTable
from rigs.rig import Rig
from rigs.schema.effect import label_of, name_of, size_field

_BETTER = 0.97
"""Ratio of the gap without an effect of the rig file to the gap with it, below which the effect is doubted. Chosen: 3 %
of the rms is more than a refitted set-up gains by chance."""


def doubts_of_runs(blocks: Sequence[Block]) -> tuple[str, ...]:
    """Return what the runs leave open, however well they are explained."""
    doubts = []
    circles = [block for block in blocks if block.sampling]
    if circles and not circles[0].measured:
        doubts.append("no circle was repeated: the noise of real cells is assumed; repeat each circle")
    alone = [block.name for block in circles if block.measured and block.count < 2]
    if alone:
        doubts.append(f"{', '.join(alone)} was driven once: its noise is assumed equal to that of the other circles")
    once = dict.fromkeys(block.name for block in blocks if not block.sampling and not block.measured)
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
        doubts.append(
            "no circle was given: effects that depend on the speed, or on how a joint turns back, hardly show"
        )
    return tuple(doubts)


def doubts_of_limits(names: Sequence[Named]) -> tuple[str, ...]:
    """Return a message for each name that stands whose size ended at the limit of fits."""
    doubts = []
    for one in names:
        size = float(getattr(one.effect, size_field(one.effect)))
        if one.stands and any(limit and math.isclose(size, limit, rel_tol=1e-6) for limit in size_limits(one.effect)):
            doubts.append(
                f"{label_of(one.effect)} ended at the limit of its size, so it is not to be trusted: check the rig "
                "file, the cables of the gauges and the placements, and diagnose again"
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
