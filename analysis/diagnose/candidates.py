"""The names that a diagnosis can give, each with the columns that it may show in the readings.

What an effect does to the readings is simulate(model + effect) - simulate(model) (`linear`); nothing is written by
hand. A column is such a response at a healthy size. Beside its main columns (two where a phase is free) a name has
columns for its shape: how a real play, gear or spike differs from the page. Which names there are, and in which forms,
the effects say themselves (`rigs/effects`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.diagnose.blocks import Block
from analysis.diagnose.linear import Linear
from analysis.kinematics.arm import Array
from analysis.reading.tables import CircleTable, PoseTable
from rigs.effect import Gauge, Scope, healthy, is_play, label_of, name_of, phases, scaled
from rigs.effects import VOCABULARY, Effect

__all__ = ["Candidate", "Shape", "candidates_for", "label_of", "name_of"]
_PLAY_SIGMAS = 15.0
_PLAYS = (1.0, 6.0, 30.0)
"""Widths of plays: the smallest that is well seen, and, in healthy widths, those of arms and of their faults."""


@dataclass(frozen=True)
class Shape:
    """A column of a name's shape: the response to `more` less that to `less`; share: how much of it, beside a main
    column at 1, is plausible."""

    more: Effect
    less: Effect | None
    share: float


@dataclass(frozen=True)
class Candidate:
    """One name in one variant. effects: one for each main column, at `size` of their healthy size (a play is not twice
    itself); share: of a healthy arm's size that this variant has among its likes (the orders of one gear)."""

    name: str
    effects: tuple[Effect, ...]
    shapes: tuple[Shape, ...] = ()
    share: float = 1.0
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
            found += [_candidate(form, size, len(forms) * len(sizes)) for size in sizes]
    return found


def _candidate(form: Effect, size: float, likes: int) -> Candidate:
    """A form at `size` of its healthy size, one among `likes` of its place."""
    whole = scaled(healthy(form), size)
    waves = phases(whole)
    shapes = tuple(
        Shape(whole.model_copy(update={free.field: free.tried[0]}), whole, free.tried[1])
        for free in form.FREE
        if free.tried
    )
    return Candidate(name_of(form), waves, shapes, 1 / float(np.sqrt(likes * len(waves))), size)


def _widths(sigma: float) -> list[float]:
    """Widths of a play in healthy ones, for how it is crossed depends on them; sigma: of a healthy one."""
    return sorted({min(1.0, _PLAY_SIGMAS / max(sigma, 1e-9)), *_PLAYS})


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
