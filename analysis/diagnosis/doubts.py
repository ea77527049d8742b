"""What a person should know before trusting a diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from analysis.diagnosis.blocks import Block
from analysis.diagnosis.observed import Seen
from analysis.diagnosis.settle import settled
from analysis.fitting.observation import rms
from analysis.traces.tables import CircleTable
from rigs.rig import Rig
from rigs.schema.effect import name_of

_BETTER = 0.97
"""Of the gap with an effect of the rig file: less without it is a reason to doubt it."""


def doubts_of_runs(blocks: Sequence[Block]) -> tuple[str, ...]:
    """What the runs leave open, however well they are explained."""
    doubts = []
    circles = [block for block in blocks if block.sampling]
    if circles and not circles[0].measured:
        doubts.append("no circle was repeated: its noise is assumed, as wide as real cells have it; repeat each circle")
    alone = [block.name for block in circles if block.measured and block.count < 2]
    if alone:
        doubts.append(f"{', '.join(alone)} was driven once: its noise is taken to be that of the other circles")
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
            doubts.append(f"{test} was driven {next(iter(seen))} only: what changes with the direction cannot be told")
    if not circles:
        doubts.append("no circle: what depends on speed or on reversals cannot be told")
    return tuple(doubts)


def doubts_of_rig(rig: Rig, runs: Sequence[Seen]) -> tuple[str, ...]:
    """Effects of the rig file without which the readings are explained better."""
    if not rig.effects:
        return ()
    whole = rms(settled(runs)[1])
    doubts = []
    for k, effect in enumerate(rig.effects):
        bare = (*rig.effects[:k], *rig.effects[k + 1 :])
        without = rms(settled([replace(run, model=replace(run.model, effects=bare)) for run in runs])[1])
        if without < _BETTER * whole:
            doubts.append(
                f"without {name_of(effect)} of the rig file the gap is {1e3 * without:.1f} instead of "
                f"{1e3 * whole:.1f} µm: take it out and diagnose again"
            )
    return tuple(doubts)
