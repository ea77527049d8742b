"""Whether the targets of a table are those of its rig file."""

from __future__ import annotations

import numpy as np

from analysis.geometry.hemisphere import target_angles
from analysis.traces.tables import RadialTable, RepeatabilityTable, Table
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.declared_tests import Hemisphere


def hold_targets(table: Table, rig: Rig, where: str) -> None:
    """Raises FileError for a target number that the rig's hemisphere does not have."""
    if rig.tests.hemisphere is None or not isinstance(table, RadialTable | RepeatabilityTable):
        return
    count = target_count(rig.tests.hemisphere)
    unknown = (table.target < 1) | (table.target > count)
    if unknown.any():
        row = int(np.argmax(unknown))
        what = f"target {table.target[row]} of row {row + 1} is not one of the {count} of the hemisphere"
        raise FileError(where, what, "correct target, or tests.hemisphere in the rig file")


def target_count(hemisphere: Hemisphere) -> int:
    """How many targets a hemisphere has."""
    return len(target_angles(hemisphere)[0])
