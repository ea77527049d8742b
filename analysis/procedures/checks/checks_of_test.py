"""Checks of a test: the evidence in its table against the labelled meaning of the columns.

A test implements them as `PART` in the module `checks` of its package; a test without this module has the usual ones.
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
    """Other reading of joint columns: q (n, axes) as labelled to q = q M' + c, with M (axes, axes), c (axes,) rad.

    words: the meaning in place of the label; remedy: the action if it is right.
    """

    columns: tuple[str, ...]
    words: str
    remedy: str
    matrix: Array
    offset: Array

    def of(self, q: Array) -> Array:
        """The angles (n, axes) rad that are meant by angles q (n, axes) rad."""
        axes = len(self.offset)
        return np.column_stack([q[:, :axes] @ self.matrix.T + self.offset, q[:, axes:]])


@dataclass(frozen=True)
class JudgedMeaning:
    """Residual of a meaning, rms in mm of `values` redundant readings."""

    meaning: Meaning
    left_mm: float
    values: int


Verdict = tuple[JudgedMeaning | None, float, list[JudgedMeaning]]
"""The meaning that fits although the labelled meaning does not, None if there is none; the residual of the labelled
meaning, rms mm; and the meanings that fit as well as the best."""


@dataclass(frozen=True)
class PathDeviation:
    """off_mm: median distance from the path; off: the same as a share of the path size; on: whether this counts as
    on the path, with the tool oriented as the test prescribes."""

    off_mm: float
    off: float
    on: bool


T_contra = TypeVar("T_contra", bound=Table, contravariant=True)
Finders = tuple[tuple[str, Callable[[T_contra, Rig], Iterable[Finding]]], ...]
"""Conventions that few tests can break, each with the function finding violations."""


class Checks(TestPart, Protocol[T_contra]):
    """Evidence against the labelled meaning of the columns of a table."""

    @property
    def finders(self) -> Finders[T_contra]:
        """Conventions that few tests can break, each with the function finding violations."""
        return ()

    def unit_findings(self, table: T_contra, rig: Rig, T_tool: Array) -> Iterable[Finding]:
        """Return the findings against units, relative to nominal tool poses T_tool (n, 4, 4), the most certain
        first."""
        return ()

    def cannot_tell(self, table: T_contra, rig: Rig) -> str:
        """Return the reason why a table cannot show the meaning of the joint columns; empty if it can."""
        return labels_of(self.test).unsupported_reason

    def judged_joints(self, table: T_contra, rig: Rig) -> Verdict:
        """Return the meaning of the joint columns that fits a table."""
        raise no_joints_error(self.test, f"rig {rig.name}")

    def off_path(self, table: T_contra, rig: Rig, T_tool: Array) -> PathDeviation | None:
        """Return the distance of tool poses T_tool (n, 4, 4) from the nominal path of the test; None if unknown."""
        return None

    def targets(self, table: T_contra, rig: Rig) -> Array | None:
        """Return the target places (n, 3) mm of the rows; None if the rig file does not contain them."""
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
