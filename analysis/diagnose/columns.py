"""All that may move the readings, as columns: every form of every effect, the set-ups, the scatter from run to run.

A form is one way in which a name may show: a gear of one order (two columns, for its phase is free), a play of one
width and crossing. A healthy arm has a little of everything, so each name's healthy size is spread over its forms.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.diagnose.blocks import BANDS
from analysis.diagnose.candidates import Candidate
from analysis.diagnose.linear import Linear
from analysis.kinematics.arm import Array
from rigs.effects import Effect, one_sided

_SET_UP_MM = 10.0
"""How far a set-up may be off from where it was first fitted: decides only what readings hardly show, such as a ball's
height above a circle's plane."""


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
    """Of one linearisation. forms; X (N, p): columns at a healthy size, then those of set-ups by mm, then those of the
    scatter; products by band: K (b, p, p)."""

    def __init__(self, linear: Linear, candidates: Sequence[Candidate]) -> None:
        variants = [variant for one in candidates for variant in _variants(one)]
        among = Counter(name for name, _, _ in variants)
        effects = [effect for _, each, _ in variants for effect in each]
        ends = np.cumsum([len(each) for _, each, _ in variants]).tolist()
        self.forms = tuple(
            Form(name, each, size, tuple(range(end - len(each), end)), among[name])
            for (name, each, size), end in zip(variants, ends, strict=True)
        )
        sizes = np.repeat([size for _, _, size in variants], [len(each) for _, each, _ in variants])
        self.X = np.concatenate([linear.columns(effects) / sizes, linear.U, linear.Z], axis=1)
        healthy = np.concatenate([np.full(len(form.columns), 1 / (form.among * len(form.columns))) for form in self.forms])
        self.healthy: Array = np.concatenate([healthy, np.zeros(linear.U.shape[1] + linear.Z.shape[1])])
        self.fixed = np.concatenate([np.zeros(len(healthy)), np.full(linear.U.shape[1], _SET_UP_MM**2), np.ones(linear.Z.shape[1])])
        self.set_ups = slice(len(healthy), len(healthy) + linear.U.shape[1])
        bands, self.band = np.unique(linear.band, return_inverse=True)
        self.test = np.unique(bands // BANDS, return_inverse=True)[1]
        self.count: NDArray[np.int64] = np.bincount(self.band)
        self.K = np.stack([self.products(self.band == b) for b in range(len(self.count))])

    def products(self, rows: NDArray[np.bool_]) -> Array:
        """Products (p, p) of the columns over some rows."""
        part = self.X[rows]
        products: Array = part.T @ part
        return products

    def variance(self, level: float) -> Array:
        """Prior variance (p,) of each column's coefficient, in an arm with `level` times a healthy one's everything."""
        return level**2 * self.healthy + self.fixed


def _variants(one: Candidate) -> list[tuple[str, tuple[Effect, ...], float]]:
    return [(one.name, one.effects, one.size), *((one.name, (shape.more,), one.size) for shape in one.shapes)]
