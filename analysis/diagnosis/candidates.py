"""The names that a diagnosis can give, each with the columns that it may show in the readings.

What an effect does to the readings is simulate(model + effect) - simulate(model) (`linear`); nothing is written by
hand. A column is such a response at a healthy size, two where a phase is free. Which names there are, in which forms
and shapes, the effects say themselves (`rigs/effects`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.blocks import Block
from analysis.diagnosis.linear import Linear
from analysis.kinematics.arm import Array
from analysis.traces.tables import CircleTable, PoseTable
from rigs.effects import VOCABULARY, Effect
from rigs.schema.effect import Gauge, Scope, healthy, is_play, name_of, phases, scaled

_PLAY_SIGMA = 15.0
_PLAYS = (1.0, 6.0, 30.0)
"""Widths of plays: the smallest that is well seen, and, in healthy widths, those of arms and of their faults."""


@dataclass(frozen=True)
class Candidate:
    """One name in one form. effects: one for each column, at `size` of their healthy size (a play is not twice itself);
    shaped: the same in other shapes, in which a search looks for it too."""

    name: str
    effects: tuple[Effect, ...]
    shaped: tuple[Effect, ...] = ()
    size: float = 1.0

    @property
    def effect(self) -> Effect:
        """The first of its columns."""
        return self.effects[0]


def candidates_for(linear: Linear) -> list[Candidate]:
    """Every effect of the vocabulary that the runs of a linearisation could show."""
    scope = _scope(linear.blocks)
    places = [forms for cls in VOCABULARY.values() for forms in cls.forms(scope)]
    plays = [healthy(form) for forms in places for form in forms if is_play(form)]
    sigmas = iter(np.linalg.norm(linear.columns(plays), axis=0))
    found = []
    for forms in places:
        for form in forms:
            sizes = _widths(float(next(sigmas))) if is_play(form) else [min(1.0, form.STRAIGHT)]
            found += [_candidate(form, size) for size in sizes]
    return found


def _candidate(form: Effect, size: float) -> Candidate:
    """A form at `size` of its healthy size."""
    whole = scaled(healthy(form), size)
    shaped = tuple(whole.model_copy(update={free.field: free.tried}) for free in form.FREE if free.tried is not None)
    return Candidate(name_of(form), phases(whole), shaped, size)


def _widths(sigma: float) -> list[float]:
    """Widths of a play in healthy ones, for how it is crossed depends on them; sigma: of a healthy one."""
    return sorted({min(1.0, _PLAY_SIGMA / max(sigma, 1e-9)), *_PLAYS})


def _scope(blocks: Sequence[Block]) -> Scope:
    """What the runs of blocks can show. A circle has two gauges, a target one."""
    tables = [block.one.table for block in blocks]
    timed = any(isinstance(table, CircleTable) for table in tables)
    gauged = any(not isinstance(table, PoseTable) for table in tables)
    gauges: tuple[Gauge, ...] = ("g1", "g2") if timed else ("g1",) if gauged else ()
    twist_deg = np.degrees(blocks[0].model.arm.alpha)
    return Scope(timed, gauges, tuple(twist_deg.tolist()), tuple(_turned(blocks).tolist()))


def _turned(blocks: Sequence[Block]) -> Array:
    """How far (6,) each joint turns, in turns, where joints turn while they are read, if anywhere: on circles."""
    swept = [block for block in blocks if isinstance(block.one.table, CircleTable)] or blocks
    turned: Array = np.max([np.ptp(block.one.table.q, axis=0) for block in swept], axis=0) / (2 * np.pi)
    return turned
