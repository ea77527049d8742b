"""What effects would add to the readings of tests not yet driven, and how far apart that is.

Signatures are whitened by noise and scatter, assumed as wide as real cells have them, less what the set-up could do as
well. A further test has a set-up
of its own, so products of signatures simply add: those of the tests planned and those of the further one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnose.blocks import blocks_of
from analysis.diagnose.diagnosis import ODDS
from analysis.diagnose.linear import Linear, basis_of
from analysis.diagnose.observed import see
from analysis.kinematics.arm import Array
from analysis.model.predict import SetUp, model_of, nominal_setup
from analysis.model.simulate import simulate
from analysis.reading.tables import CircleTable, Table
from rigs.effects import Effect, one_sided
from rigs.rig import Rig
from rigs.vocabulary import CIRCLES, TestName

DETECTABLE = 7.0
"""Sigmas at which an effect alone is seen."""
LARGEST = 25.0
"""Healthy sizes at which an effect must at least be seen to be testable."""
ALIKE = float(np.sqrt(2 * np.log(ODDS)))
"""Sigmas below which the odds between two names stay within those at which a diagnosis dismisses a rival."""
_OWN_SHARE = 0.02
"""Of a signature that no set-up could do; less is what the straight lines of a linearisation leave of curved ones."""
NOTHING = 1e-3
"""Sigmas that are none."""


def parts(sigma: float) -> bool:
    """Whether two names so far apart are told apart."""
    return sigma >= ALIKE


def shows(sigma: float) -> bool:
    """Whether a name is seen that has so many sigmas at a healthy size."""
    return LARGEST * sigma >= DETECTABLE


class View:
    """What effects add to the readings of some tests of a rig, each repeated, in standard deviations."""

    def __init__(self, rig: Rig, tests: Sequence[TestName], runs: int) -> None:
        model = model_of(rig)
        seen = [see(model, table, rig.name) for table in _tables(rig, tests)]
        setups = {run.one.setup: _setup(rig, run.one.table) for run in seen}
        self.linear = Linear(blocks_of(seen, setups), setups)
        self._repeats = np.sqrt(runs)
        left, size, _ = np.linalg.svd(self.linear.Z, full_matrices=False)
        self._scatter, self._taken = left, 1 - 1 / np.sqrt(1 + size**2)
        self._basis = basis_of(self._white(self.linear.U))

    def _white(self, columns: Array) -> Array:
        """Columns (N, p) over the noise with the scatter from run to run, (1 + ZZ')^(-1/2) of them."""
        white: Array = columns - self._scatter @ (self._taken[:, None] * (self._scatter.T @ columns))
        return white

    def _projected(self, columns: Array) -> Array:
        return columns - self._basis @ (self._basis.T @ columns)

    def columns(self, effects: Sequence[Effect]) -> tuple[Array, Array]:
        """Signatures (N, p), zero where the set-up takes them up, and their lengths (p,) before it does."""
        raw = self._white(self.linear.columns(effects))
        own, whole = self._projected(raw), np.linalg.norm(raw, axis=0)
        own[:, np.linalg.norm(own, axis=0) < _OWN_SHARE * whole] = 0.0
        return self._repeats * own, self._repeats * whole


_SET_BY_HAND_MM = (0.6, -0.4, 0.1)
"""Off the circle's centre, where the rig file does not say: no ball is set exactly, and what scales the readings shows
only where they move."""


def _tables(rig: Rig, tests: Sequence[TestName]) -> list[Table]:
    """The tests as driven; their readings do not matter, nothing is measured yet. Yaw and roll are one motion, and a cw
    program drives the joint angles of the acw one back."""
    tables = [simulate(rig, test, None, None) for test in tests if test not in CIRCLES]
    if "yaw" in tests or "roll" in tests:
        acw = simulate(rig, "yaw", "acw", None)
        assert isinstance(acw, CircleTable)  # noqa: S101 - what simulate makes of a circle
        cw = replace(acw, direction="cw", t_s=acw.t_s[-1] - acw.t_s[::-1], q=acw.q[::-1])
        tables += [acw, cw] if "yaw" in tests else []
        tables += [replace(lap, test="roll") for lap in (acw, cw)] if "roll" in tests else []
    return tables


def _setup(rig: Rig, table: Table) -> SetUp:
    setup = nominal_setup(rig, table)
    if isinstance(table, CircleTable) and rig.tests.circle:
        off_mm = rig.tests.circle.eccentricity_mm
        return replace(setup, ball=setup.ball + np.array(off_mm if any(off_mm) else _SET_BY_HAND_MM))
    return setup


class Signatures:
    """Items to tell apart: each one effect, or two where a phase is free. sizes (n,): of each, in the size that is
    meant (a healthy one, say); all results are for the size that is meant."""

    def __init__(self, forms: Sequence[tuple[Effect, ...]], sizes: Array) -> None:
        self._effects = [effect for form in forms for effect in form]
        ends = np.cumsum([len(form) for form in forms])
        self._columns = [np.arange(end - len(form), end) for form, end in zip(forms, ends, strict=True)]
        self._sizes = np.repeat(sizes, [len(form) for form in forms])
        self._one_sided = np.array([len(form) == 1 and one_sided(form[0]) for form in forms], dtype=bool)

    def products(self, view: View) -> Array:
        """Products (p, p) of all signatures in a view."""
        columns = view.columns(self._effects)[0] / self._sizes
        products: Array = columns.T @ columns
        return products

    def lengths(self, products: Array) -> Array:
        """Sigmas (n,) of each item, in the phase that shows most."""
        squares = np.diag(products)
        lengths: Array = np.sqrt(np.array([squares[own].max() for own in self._columns]))
        return lengths

    def apart(self, products: Array, lengths: Array) -> Array:
        """Sigmas (n, n) between item i, as long as lengths (n,) says, and what item j can do at any size or phase."""
        first, second = np.zeros((2, len(products), len(self._columns)))
        for k, own in enumerate(self._columns):
            most, *rest = own[np.argsort(-np.diag(products)[own])]
            first[most, k] = 1 / _length(products[most, most])
            for other in rest:
                along = products[other, most] / _length(products[most, most]) ** 2
                across = _length(products[other, other] - along * products[other, most])
                second[[other, most], k] = [1 / across, -along / across]
        shadow = first.T @ products
        cosine = shadow @ first
        # Two widths cannot stand in for each other with opposite signs.
        cosine[np.logical_and.outer(self._one_sided, self._one_sided) & (cosine < 0)] = 0.0
        sine: Array = np.sqrt(np.clip(1 - cosine**2 - (shadow @ second) ** 2, 0.0, 1.0))
        return lengths[:, None] * sine


def _length(square: float) -> float:
    return max(float(np.sqrt(max(square, 0.0))), NOTHING)
