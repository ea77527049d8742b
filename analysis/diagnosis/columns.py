"""All that may move the readings, as columns: every form of every effect, the set-ups, the scatter from run to run.

A form is one way in which a name may show: a gear of one order (two columns, for its phase is free), a play of one
width and crossing. A healthy arm has a little of everything, so each name's healthy size is spread over its forms.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.candidates import Candidate
from analysis.diagnosis.forms import begin_columns
from analysis.diagnosis.linear import Linear
from analysis.kinematics.arm import Array
from rigs.effects import Effect, one_sided
from rigs.schema.effect import healthy, is_play, name_of

_SET_UP_MM = 10.0
"""How far a set-up may be off from where it was first fitted: decides only what readings hardly show, such as a ball's
height above a circle's plane."""
_SHOWS = 3.0
"""Sigmas, were the set-up known, that the largest fault must have to be worth a column."""
LARGEST = 68.0
"""Of a fault, in healthy sizes."""


@dataclass(frozen=True)
class Form:
    """One way in which a name may show. effects: of each column; size: that they have, in healthy sizes; columns:
    their numbers; among: how many forms the name has."""

    name: str
    effects: tuple[Effect, ...]
    size: float
    columns: tuple[int, ...]
    among: int

    @property
    def one_sided(self) -> bool:
        """Whether its size cannot be negative."""
        return len(self.effects) == 1 and one_sided(self.effects[0])


class Columns:
    """Of one linearisation.

    forms; among: how many of them each name has; X (N, p): columns at a healthy size, then those of set-ups by mm, then
    those of the scatter; rows: of each band; K (b, p, p): products of the columns by band, gram (p, p) over all.
    """

    def __init__(self, linear: Linear, candidates: Sequence[Candidate]) -> None:
        every = [form for one in candidates for form in _in_each_shape(one)]
        sizes = np.repeat([one.size for one in every], [len(one.effects) for one in every])
        columns = linear.columns([effect for one in every for effect in one.effects]) / sizes
        self.not_seen, kept, columns = _seen(every, columns)
        self.among = Counter(one.name for one in kept)
        ends = np.cumsum([len(one.effects) for one in kept]).tolist()
        self.forms = tuple(
            Form(one.name, one.effects, one.size, tuple(range(end - len(one.effects), end)), self.among[one.name])
            for one, end in zip(kept, ends, strict=True)
        )
        # Every joint of a healthy arm has some play, and where in it a run began nobody knows.
        plays = [healthy(one.effect) for one in candidates if is_play(one.effect)]
        begins = begin_columns(linear, list({name_of(play): play for play in plays}.values()))
        self.X = np.concatenate([columns, linear.U, linear.Z, begins], axis=1)
        numbers = {name: k for k, name in enumerate(self.among)}
        own = np.concatenate([np.full(len(form.columns), numbers[form.name]) for form in self.forms])
        self.name_of_column = np.concatenate([own, np.full(self.X.shape[1] - len(own), -1)])
        share = np.concatenate(
            [np.full(len(form.columns), 1 / (form.among * len(form.columns))) for form in self.forms]
        )
        self.healthy: Array = np.concatenate([share, np.zeros(self.X.shape[1] - len(share))])
        self.fixed = np.concatenate(
            [
                np.zeros(len(share)),
                np.full(linear.U.shape[1], _SET_UP_MM**2),
                np.ones(linear.Z.shape[1] + begins.shape[1]),
            ]
        )
        self.set_ups = slice(len(share), len(share) + linear.U.shape[1])
        self.divide(np.unique(linear.band, return_inverse=True)[1])

    def divide(self, band: NDArray[np.int64]) -> None:
        """Products of the columns by the band (N,) of their readings."""
        self.band = band
        self.count: NDArray[np.int64] = np.bincount(band)
        self.rows = [np.flatnonzero(band == b) for b in range(len(self.count))]
        self.K = np.stack([self.X[rows].T @ self.X[rows] for rows in self.rows])
        self.gram: Array = self.K.sum(axis=0)

    def variance(self, level: float) -> Array:
        """Prior variance (p,) of each column's coefficient, in an arm with `level` times a healthy one's everything."""
        variance: Array = level**2 * self.healthy + self.fixed
        return variance


def _seen(every: Sequence[Candidate], columns: Array) -> tuple[tuple[str, ...], list[Candidate], Array]:
    """Names that no size would show, the forms that would show, and their columns."""
    widths = [len(one.effects) for one in every]
    sigma = LARGEST * np.linalg.norm(columns, axis=0)
    shows = [bool(own.max() > _SHOWS) for own in np.split(sigma, np.cumsum(widths)[:-1])]
    kept = [one for one, there in zip(every, shows, strict=True) if there]
    names = {one.name for one in kept}
    hidden = tuple(dict.fromkeys(one.name for one in every if one.name not in names))
    return hidden, kept, columns[:, np.repeat(shows, widths)]


def _in_each_shape(one: Candidate) -> list[Candidate]:
    return [one, *(replace(one, effects=(effect,)) for effect in one.shaped)]
