"""References of a cell: earlier runs that new readings can be compared with to find what moved."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from analysis.movement.inference import FEWEST_OF_REFERENCE
from analysis.procedures.facts import facts_of, shows_joints
from daq.store import RunInfo, read_run, survey
from rigs.errors import FileError, RigError
from rigs.schema.vocabulary import CIRCLES, TestName


@dataclass(frozen=True)
class CellReference:
    """Runs of a healthy cell. test: kind of test. count: number of touches or poses, for circles of runs. day: date of
    the newest run.
    """

    rig: str
    runs: tuple[Path, ...]
    test: TestName
    count: int
    day: str

    @property
    def can_be_touched(self) -> bool:
        """True if a robot without an instrument can repeat the readings."""
        facts = facts_of(self.test)
        return facts.of_places and not facts.of_tracker


def references_of(directories: Iterable[Path], rig_name: str | None = None) -> list[CellReference]:
    """References in directories of runs, touches and poses before circles, each newest first.

    rig_name: name of the rig; None for all rigs.

    Touches and poses are a reference if there are enough of them, and circles if a day has both directions. Runs of a
    corrected robot and movement checks are left out.
    """
    runs = [run for directory in directories for run in _usable_runs(directory, rig_name)]
    places = [reference for run in runs if (reference := _of_places(run)) is not None]
    newest_first = sorted(places, key=lambda reference: reference.day, reverse=True)
    return [*newest_first, *_of_circles(runs)]


def _usable_runs(directory: Path, rig_name: str | None) -> list[RunInfo]:
    """Complete runs of a rig with joint angles; none if the directory does not exist."""
    usable = []
    with suppress(FileError):
        for run in survey(directory):
            manifest = run.manifest
            if manifest is None or rig_name not in (None, manifest.rig_name):
                continue
            is_check = run.marks is not None and run.marks.moved is not None
            is_whole = run.status in ("complete", "recovered")
            if is_whole and not manifest.corrected and not is_check and shows_joints(manifest.test):
                usable.append(run)
    return usable


def _of_places(run: RunInfo) -> CellReference | None:
    """Run of touches or poses as a reference; None if it has too few."""
    manifest = run.manifest
    if manifest is None or not facts_of(manifest.test).of_places:
        return None
    with suppress(RigError):
        table = read_run(run.path).table
        if table is not None and table.num_rows >= FEWEST_OF_REFERENCE:
            return CellReference(manifest.rig_name, (run.path,), manifest.test, table.num_rows, manifest.started[:10])
    return None


def _of_circles(runs: Sequence[RunInfo]) -> list[CellReference]:
    """Days with circles in both directions, newest first."""
    days: dict[tuple[str, TestName, str], list[RunInfo]] = {}
    for run in runs:
        manifest = run.manifest
        if manifest is not None and manifest.test in CIRCLES:
            days.setdefault((manifest.started[:10], manifest.test, manifest.rig_name), []).append(run)
    return [
        CellReference(rig, tuple(run.path for run in of_day), test, len(of_day), day)
        for (day, test, rig), of_day in sorted(days.items(), reverse=True)
        if {run.manifest.direction for run in of_day if run.manifest} >= {"acw", "cw"}
    ]
