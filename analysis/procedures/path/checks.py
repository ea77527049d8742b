"""Checks of a tracker recording along paths."""

from __future__ import annotations

from analysis.procedures.checks.checks_of_test import Checks, Finders
from analysis.procedures.checks.lost_poses import DUPLICATES, WILDNESS, outlying_places, repeated_places
from analysis.runs.tables import PathTable


class PathChecks(Checks[PathTable]):
    """Evidence in a recording along paths."""

    @property
    def finders(self) -> Finders[PathTable]:
        return ((WILDNESS, outlying_places), (DUPLICATES, repeated_places))


PART = PathChecks
