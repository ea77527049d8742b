"""Correcting the label of a run that has ended: test, direction, operator, placement.

The old words are kept in its ledger, or in the manifest of a run of version 1. Nothing else of the run changes: chunks
and their checksums, stamps, the rig file and the name are as they were.
"""

from __future__ import annotations

from pathlib import Path
from typing import get_args

from pydantic import ValidationError

from daq.store import durable
from daq.store.ledger import BEING_RECORDED, Entry, Ledger, Relabelling, first_error, iso_now, to_recover
from daq.store.manifest import PLACEMENT_RULE, Manifest, hold_operator, load_manifest
from rigs.errors import CellError, FileError, UseError
from rigs.schema.vocabulary import CIRCLES, Direction, DrivenTest, TestName


def relabel(
    run: Path,
    *,
    test: TestName | None = None,
    direction: Direction | None = None,
    operator: str | None = None,
    placement: str | None = None,
) -> Manifest:
    """Give a run another test, direction, operator or placement, durably and all at once; None leaves a word as it is.

    A run that becomes one without a circle loses its direction. Returns the manifest as it is now. Raises FileError
    where the run is being recorded, was not closed, or cannot be what the words say; UseError for words that no run
    may hold; CellError when the disk refuses.
    """
    unchanged = load_manifest(run)
    try:
        lock = durable.try_lock(run)
        if lock is None and unchanged.exit_status == "recording":
            raise FileError(str(run), *BEING_RECORDED)
        if lock is None:
            raise FileError(str(run), "is being changed by another program", "try again when it has ended")
        try:
            manifest = load_manifest(run)
            if manifest.exit_status == "recording" or any(run.glob("*.arrow")):
                raise FileError(str(run), "was not closed: the recording crashed", to_recover(run))
            changed = _relabelled(run, manifest, test, direction, operator, placement)
            if changed != manifest:
                _save(run, changed, changed.relabelled[len(manifest.relabelled) :])
        finally:
            durable.close(lock)
    except OSError as error:
        problem = f"cannot be relabelled: {error.strerror or error}"
        raise CellError(str(run), problem, "do it as the owner of the run, where there is room") from None
    return changed


def _save(run: Path, changed: Manifest, changes: tuple[Relabelling, ...]) -> None:
    if changed.version == 1:
        changed.save(run)
        return
    ledger = Ledger.resume(run)
    try:
        ledger.append(Entry(relabelled=changes))
    finally:
        ledger.close()


def _relabelled(
    run: Path,
    manifest: Manifest,
    test: TestName | None,
    direction: Direction | None,
    operator: str | None,
    placement: str | None,
) -> Manifest:
    words: dict[str, str | None] = {}
    if test is not None or direction is not None:
        words = _test_and_direction(run, manifest, test or manifest.test, direction)
    if operator is not None:
        words["operator"] = hold_operator(operator)
    if placement is not None:
        words["placement"] = placement
    at = iso_now()
    changes = [
        {"at": at, "field": field, "old": old, "new": new}
        for field, new in words.items()
        if new != (old := getattr(manifest, field))
    ]
    history = [change.model_dump() for change in manifest.relabelled]
    if not changes:
        return manifest
    try:
        return manifest.updated(**words, relabelled=[*history, *changes])
    except ValidationError as error:
        raise UseError(str(run), first_error(error), PLACEMENT_RULE) from None


def _test_and_direction(
    run: Path, manifest: Manifest, test: TestName, direction: Direction | None
) -> dict[str, str | None]:
    """What both become. Raises FileError where the run cannot be that, UseError for a direction without a circle."""
    if test != manifest.test and not _alike(manifest, test):
        problem = f"holds data of a {manifest.test} test, which cannot be of a {test} test"
        raise FileError(str(run), problem, f"import them again with --test {test}")
    if test not in CIRCLES:
        if direction is not None and test != manifest.test:
            raise UseError("--direction", f"a {test} test has no direction", "leave it out")
        if direction is not None:
            raise FileError(str(run), f"is of a {test} test, which has no direction", "leave --direction out")
        return {"test": test, "direction": None}
    if (direction or manifest.direction) is None:
        raise FileError(str(run), f"a {test} test has a direction, and the run has none", "add --direction acw or cw")
    if manifest.table is not None and direction not in (None, manifest.direction):
        # Each row of the table says it too, and tables are never changed.
        problem = f"holds an imported table whose rows say {manifest.direction}"
        remedy = f"import it again with --direction {direction}, its direction column left out"
        raise FileError(str(run), problem, remedy)
    return {"test": test, "direction": direction or manifest.direction}


def _alike(manifest: Manifest, test: TestName) -> bool:
    """Whether data may be of another test: recorded streams of any with gauges, a table of either circle."""
    alike: tuple[TestName, ...] = get_args(DrivenTest) if manifest.table is None else CIRCLES
    return manifest.test in alike and test in alike
