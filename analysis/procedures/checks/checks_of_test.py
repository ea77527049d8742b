"""Checks of a test: the evidence in its table for or against the labelled meaning of the columns.

A test implements them as `PART` in the module `checks` of its package. A test without this module has the usual checks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from typing import Protocol, TypeVar

import numpy as np

from analysis.procedures.checks.finding import Finding
from analysis.procedures.facts import labels_of, no_joints_error
from analysis.robot.kinematics.arm import Array
from analysis.runs.parts_of_tests import TestPart, part_of
from analysis.runs.tables import Table
from rigs.rig import Rig
from rigs.schema.vocabulary import TestName


@dataclass(frozen=True)
class Meaning:
    """A different meaning of the joint columns: q (n, axes) as labelled becomes q M' + c, with M (axes, axes), c
    (axes,) rad.

    words: description of the meaning. remedy: action if it is correct. mistakes: number of independent mistakes that
    it assumes.
    """

    columns: tuple[str, ...]
    words: str
    remedy: str
    matrix: Array
    offset: Array
    mistakes: int = 1

    def of(self, q: Array) -> Array:
        """Return the true angles (n, axes) rad for labelled angles q (n, axes) rad."""
        axes = len(self.offset)
        return np.column_stack([q[:, :axes] @ self.matrix.T + self.offset, q[:, axes:]])


@dataclass(frozen=True)
class JudgedMeaning:
    """A meaning with its residual: rms in mm of `values` redundant readings."""

    meaning: Meaning
    left_mm: float
    values: int


Verdict = tuple[JudgedMeaning | None, float, list[JudgedMeaning]]
"""Result of comparing meanings: the meaning that fits although the labelled one does not, or None; the residual of
the labelled meaning, rms mm; and all meanings that fit as well as the best.
"""


@dataclass(frozen=True)
class PathDeviation:
    """Deviation of tool poses from the path of a test.

    off_mm: median distance from the path. off: the same as a share of the path size. on: True if the deviation is
    acceptable and the tool has the prescribed orientation.
    """

    off_mm: float
    off: float
    on: bool


T_contra = TypeVar("T_contra", bound=Table, contravariant=True)
Finders = tuple[tuple[str, Callable[[T_contra, Rig], Iterable[Finding]]], ...]
"""Conventions that apply only to few tests, each with the function that finds violations."""


class Checks(TestPart, Protocol[T_contra]):
    """Evidence in a table for or against the labelled meaning of its columns."""

    @property
    def finders(self) -> Finders[T_contra]:
        """Return the conventions that apply only to few tests, each with the function that finds violations."""
        return ()

    def unit_findings(self, table: T_contra, rig: Rig, T_tool: Array) -> Iterable[Finding]:
        """Return the findings about units, most certain first. T_tool (n, 4, 4): nominal tool poses."""
        return ()

    def cannot_tell(self, table: T_contra, rig: Rig) -> str:
        """Return the reason why a table cannot reveal the meaning of the joint columns; empty if it can."""
        return labels_of(self.test).unsupported_reason

    def judged_joints(self, table: T_contra, rig: Rig) -> Verdict:
        """Compare the possible meanings of the joint columns by their fit to a table."""
        raise no_joints_error(self.test, f"rig {rig.name}")

    def off_path(self, table: T_contra, rig: Rig, T_tool: Array) -> PathDeviation | None:
        """Return the deviation of tool poses T_tool (n, 4, 4) from the nominal path of the test; None if the path is
        unknown.
        """
        return None

    def targets(self, table: T_contra, rig: Rig) -> Array | None:
        """Return the target positions (n, 3) mm of the rows; None if the rig file does not contain them."""
        return None


class _UsualChecks(Checks[Table]):
    """Checks of a test whose package contains none."""


@cache
def checks_of(test: TestName) -> Checks[Table]:
    """Return the checks of a test. Raises FileError if its package is unusable."""
    return part_of(test, "checks", _UsualChecks)


def findings_against(convention: str, table: Table, rig: Rig) -> Iterable[Finding]:
    """Return the findings of a table against a convention, by the finders of its test."""
    find = dict(checks_of(table.test).finders).get(convention)
    return find(table, rig) if find else ()
