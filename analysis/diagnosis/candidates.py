"""The candidates: the names that a diagnosis can give, each with its possible columns in the readings.

The response to an effect is simulate(model + effect) - simulate(model) (`linearisation`), so that no response is
written by hand. A column is such a response at a healthy size; an effect with a free phase has two. The effects
themselves define the available names, forms and shapes (`rigs/effects`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.blocks import Block
from analysis.diagnosis.linearisation import Linearisation
from analysis.kinematics.arm import Array
from analysis.traces.tables import CircleTable, PoseTable
from rigs.effects import VOCABULARY, Effect
from rigs.schema.effect import Gauge, Scope, healthy, is_play, name_of, phases, scaled

_PLAY_SIGMA = 15.0
"""Size in sigmas of the narrowest play that is tried. Chosen: well above the detection limit of 7 sigma."""
_PLAYS = (1.0, 6.0, 30.0)
"""Widths of plays that are tried, in healthy widths: that of healthy arms, and two of faults, which are 5 to 100
healthy sizes. Chosen: a factor of about five apart, since the fit then adjusts the width."""


@dataclass(frozen=True)
class Candidate:
    """One name in one form. `effects` has one effect for each column, at `size` of its healthy size, because the
    response to a play is not proportional to its width. `shaped` has the same effect in the other shapes that a search
    also tries."""

    name: str
    effects: tuple[Effect, ...]
    shaped: tuple[Effect, ...] = ()
    size: float = 1.0

    @property
    def effect(self) -> Effect:
        """The effect of its first column."""
        return self.effects[0]


def candidates_for(linear: Linearisation) -> list[Candidate]:
    """Return every effect of the vocabulary that the runs of a linearisation, with their N entries, could show."""
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
    """Return the candidate of a form at `size` of its healthy size."""
    whole = scaled(healthy(form), size)
    shaped = tuple(whole.model_copy(update={free.field: free.tried}) for free in form.FREE if free.tried is not None)
    return Candidate(name_of(form), phases(whole), shaped, size)


def _widths(sigma: float) -> list[float]:
    """Return the widths of a play to try, in healthy widths, given the sigmas of a healthy one. The response to a play
    depends on its width."""
    return sorted({min(1.0, _PLAY_SIGMA / max(sigma, 1e-9)), *_PLAYS})


def _scope(blocks: Sequence[Block]) -> Scope:
    """Return what the runs of the blocks can show. A circle has two gauges, a target has one."""
    tables = [block.one.table for block in blocks]
    timed = any(isinstance(table, CircleTable) for table in tables)
    gauged = any(not isinstance(table, PoseTable) for table in tables)
    gauges: tuple[Gauge, ...] = ("g1", "g2") if timed else ("g1",) if gauged else ()
    twist_deg = np.degrees(blocks[0].model.arm.alpha)
    return Scope(timed, gauges, tuple(twist_deg.tolist()), tuple(_turned(blocks).tolist()))


def _turned(blocks: Sequence[Block]) -> Array:
    """Return the range (6,) of each joint in turns, on circles if there are any, where joints move while they
    are read."""
    swept = [block for block in blocks if isinstance(block.one.table, CircleTable)] or blocks
    turned: Array = np.max([np.ptp(block.one.table.q, axis=0) for block in swept], axis=0) / (2 * np.pi)
    return turned
