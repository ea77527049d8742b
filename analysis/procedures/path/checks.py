"""Checks of a tracker recording along paths."""

from __future__ import annotations

from analysis.procedures.checks.checks_of_test import Checks, Finders
from analysis.procedures.checks.lost_poses import DUPLICATES, WILDNESS, repeated_places, wild_places
from analysis.runs.tables import PathTable


class PathChecks(Checks[PathTable]):
    """Evidence in a recording along paths."""

    @property
    def finders(self) -> Finders[PathTable]:
        return ((WILDNESS, wild_places), (DUPLICATES, repeated_places))


PART = PathChecks
