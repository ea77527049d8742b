"""The columns: everything that may change the readings, namely every form of every effect, the set-ups, and the scatter
between runs.

A form is one way in which a name may appear: a gear error of one order (two columns, because its phase is free), or a
play of one width and crossing. A healthy arm has a little of every effect, so the healthy size of each name is
distributed over its forms.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.candidates import Candidate
from analysis.diagnosis.departures import initial_play_columns
from analysis.diagnosis.linearisation import Linearisation
from analysis.kinematics.arm import Array
from rigs.effects import Effect, one_sided
from rigs.schema.effect import healthy, is_play, name_of

_SET_UP_MM = 10.0
"""Prior standard deviation of a set-up term about its first fit. It affects only what readings hardly determine, such
as a ball's height above the plane of a circle. Chosen: larger than any error of a fitted set-up."""
_DETECTABLE_SIGMA = 3.0
"""Smallest size in sigmas that the largest fault must have, were the set-up known, for its form to get a column.
Chosen: below the 7 sigma at which an effect is detected."""
LARGEST_FAULT = 68.0
"""Largest size of a fault, in healthy sizes: the last of the sizes 6, 11, 20, 37 and 68, since faults are 5 to 100
healthy sizes."""


@dataclass(frozen=True)
class Form:
    """One way in which a name may appear. `effects` has the effect of each column, `size` is their size in healthy
    sizes, `columns` has their indices, and `among` is the number of forms of the name."""

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
    """The columns of one linearisation.

    `X` (N, p) has the columns of forms per healthy size, then those of set-ups per mm, then those of the scatter.
    `among` counts the forms of each name. `rows` lists the entries of each band, `K` (b, p, p) has the products of the
    columns by band.
    """

    def __init__(self, linear: Linearisation, candidates: Sequence[Candidate]) -> None:
        every = in_each_shape(candidates)
        sizes = np.repeat([one.size for one in every], [len(one.effects) for one in every])
        columns = linear.columns([effect for one in every for effect in one.effects]) / sizes
        self.not_seen, kept, columns = _detectable(every, columns)
        self.among = Counter(one.name for one in kept)
        self.forms = forms_of(kept)
        # Every joint of a healthy arm has some play, and its position in the play at the start of a run is unknown.
        plays = [healthy(one.effect) for one in candidates if is_play(one.effect)]
        begins = initial_play_columns(linear, list({name_of(play): play for play in plays}.values()))
        self.X = np.concatenate([columns, linear.U, linear.Z, begins], axis=1)
        numbers = {name: k for k, name in enumerate(self.among)}
        own = np.concatenate([np.full(len(form.columns), numbers[form.name]) for form in self.forms])
        self.name_of_column = np.concatenate([own, np.full(self.X.shape[1] - len(own), -1)])
        share = healthy_shares(self.forms)
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
        """Compute the products of the whitened columns by the band (N,) of the entries."""
        self.band = band
        self.count: NDArray[np.int64] = np.bincount(band)
        self.rows = [np.flatnonzero(band == b) for b in range(len(self.count))]
        self.K = np.stack([self.X[rows].T @ self.X[rows] for rows in self.rows])

    @cached_property
    def gram(self) -> Array:
        """The products (p, p) of the whitened columns over all bands."""
        found: Array = self.K.sum(axis=0)
        return found

    def variance(self, level: float) -> Array:
        """Return the prior variance (p,) of the coefficients in an arm that has `level` times the healthy size of every
        effect."""
        variance: Array = level**2 * self.healthy + self.fixed
        return variance


def _detectable(every: Sequence[Candidate], columns: Array) -> tuple[tuple[str, ...], list[Candidate], Array]:
    """Return the names that no fault size makes visible, the forms that are visible, and the columns (N, p) of these
    forms."""
    widths = [len(one.effects) for one in every]
    sigma = LARGEST_FAULT * np.linalg.norm(columns, axis=0)
    shows = [bool(own.max() > _DETECTABLE_SIGMA) for own in np.split(sigma, np.cumsum(widths)[:-1])]
    kept = [one for one, there in zip(every, shows, strict=True) if there]
    names = {one.name for one in kept}
    hidden = tuple(dict.fromkeys(one.name for one in every if one.name not in names))
    return hidden, kept, columns[:, np.repeat(shows, widths)]


def in_each_shape(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return candidates, each followed by its variants in other shapes."""
    return [form for one in candidates for form in (one, *(replace(one, effects=(own,)) for own in one.shaped))]


def forms_of(every: Sequence[Candidate]) -> tuple[Form, ...]:
    """Return the forms of candidates, with columns in their order."""
    among = Counter(one.name for one in every)
    ends = np.cumsum([len(one.effects) for one in every]).tolist()
    return tuple(
        Form(one.name, one.effects, one.size, tuple(range(end - len(one.effects), end)), among[one.name])
        for one, end in zip(every, ends, strict=True)
    )


def healthy_shares(forms: Sequence[Form]) -> Array:
    """Return the prior variance (p,) of the columns of forms in a healthy arm, in healthy sizes squared: each name's is
    distributed over its forms."""
    shares: Array = np.concatenate([np.full(len(one.columns), 1 / (one.among * len(one.columns))) for one in forms])
    return shares
