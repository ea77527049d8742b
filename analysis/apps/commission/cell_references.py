"""Earlier runs of a cell that new readings can be compared with."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from analysis.movement.inference import FEWEST_OF_REFERENCE
from analysis.procedures.shared.test_kind import facts_of, shows_joints
from daq.store import Manifest, read_run, survey
from rigs.errors import FileError, RigError
from rigs.schema.vocabulary import CIRCLES, TestName


@dataclass(frozen=True)
class CellReference:
    """Runs of a healthy cell."""

    rig: str
    runs: tuple[Path, ...]
    test: TestName
    count: int
    """Number of touches or poses; of circles the number of runs."""
    day: str
    """Date of the newest run."""

    @property
    def can_be_touched(self) -> bool:
        """True if a robot without an instrument can repeat the readings."""
        facts = facts_of(self.test)
        return facts.of_places and not facts.of_tracker


def references_of(directories: Iterable[Path], rig_name: str | None = None) -> list[CellReference]:
    """Touches and poses of a rig (None: of all rigs), newest first, then days with circles in both directions.

    Excludes incomplete runs, those of a corrected robot, and checks of movement.
    """
    touched: list[CellReference] = []
    days: dict[tuple[str, TestName, str], list[tuple[Path, str | None]]] = {}
    for path, manifest in _usable_runs(directories, rig_name):
        day = manifest.started[:10]
        if manifest.test in CIRCLES:
            days.setdefault((day, manifest.test, manifest.rig_name), []).append((path, manifest.direction))
        elif facts_of(manifest.test).of_places:
            with suppress(RigError):
                table = read_run(path).table
                if table is not None and table.num_rows >= FEWEST_OF_REFERENCE:
                    touched.append(CellReference(manifest.rig_name, (path,), manifest.test, table.num_rows, day))
    circles = [
        CellReference(rig, tuple(path for path, _ in of_day), test, len(of_day), day)
        for (day, test, rig), of_day in sorted(days.items(), reverse=True)
        if {direction for _, direction in of_day} >= {"acw", "cw"}
    ]
    return [*sorted(touched, key=lambda reference: reference.day, reverse=True), *circles]


def _usable_runs(directories: Iterable[Path], rig_name: str | None) -> Iterator[tuple[Path, Manifest]]:
    for directory in directories:
        with suppress(FileError):
            for run in survey(directory):
                manifest = run.manifest
                if manifest is None or manifest.corrected or rig_name not in (None, manifest.rig_name):
                    continue
                is_check = run.marks is not None and run.marks.moved is not None
                if run.status in ("complete", "recovered") and not is_check and shows_joints(manifest.test):
                    yield run.path, manifest
