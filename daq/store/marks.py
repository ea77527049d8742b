"""Changes to a finished run: corrected labels (test, direction, operator, placement), and marks.

Earlier label values are stored in the ledger, or in the manifest for a run of version 1. The marks are in `marks.json`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal, get_args

from pydantic import ValidationError

from daq.store import durable
from daq.store.ledger import BEING_RECORDED, JsonRecord, Ledger, LedgerEntry, Text, first_error, iso_now, to_recover
from daq.store.manifest import PLACEMENT_RULE, Manifest, check_operator, load_manifest, unreadable
from rigs.errors import CellError, FileError, UseError
from rigs.files import of_newer_rig, read_bytes
from rigs.schema.vocabulary import CIRCLES, Direction, DrivenTest, TestName

MARKS = "marks.json"
_MOST_BYTES = 1_000_000


class Export(JsonRecord):
    at: str
    format: str
    file: Text


class MovementCheck(JsonRecord):
    at: str
    reference: tuple[str, ...]
    what: str
    """Kind of the cause that moved; empty if the readings do not decide."""
    axis: int | None = None
    name: str = ""
    """Name of a socket, target or instrument."""
    probability: float
    answer: Text
    """Sentence for the user, in English."""


class RunMarks(JsonRecord):
    """All marks of a run. moved: None if the run was not compared with a reference."""

    version: Literal[1] = 1
    kept: bool = False
    exports: tuple[Export, ...] = ()
    moved: MovementCheck | None = None


def load_marks(run: Path) -> RunMarks:
    path = run / MARKS
    try:
        return RunMarks.model_validate_json(read_bytes(path, _MOST_BYTES))
    except FileNotFoundError:
        return RunMarks()
    except ValidationError as error:
        if newer := of_newer_rig(str(path), error):
            raise newer from None
        raise FileError(
            str(path),
            f"is damaged: {first_error(error)}",
            "delete the file, then mark the run a second time",
            code="run.damaged",
        ) from None
    except OSError as error:
        raise unreadable(path, error) from None


def mark_exported(run: Path, to: str, file: Path) -> None:
    export = Export(at=iso_now(), format=to, file=str(file.absolute()))
    _change(run, lambda marks: marks.model_copy(update={"exports": (*marks.exports, export)}))


def mark_moved(run: Path, check: MovementCheck) -> None:
    _change(run, lambda marks: marks.model_copy(update={"moved": check}))


def mark_kept(run: Path, kept: bool) -> None:
    _change(run, lambda marks: marks.model_copy(update={"kept": kept}))


def _change(run: Path, change: Callable[[RunMarks], RunMarks]) -> None:
    load_manifest(run)
    with _locked(run, "marked"):
        marks = change(load_marks(run))
        durable.replace(run / MARKS, marks.model_dump_json(indent=1, exclude_none=True).encode())


@contextmanager
def _locked(run: Path, changed: str) -> Iterator[None]:
    """Lock a run, and report errors of the disk. Raises FileError if another program records or changes the run."""
    try:
        lock = durable.try_lock(run)
        if lock is None:
            if load_manifest(run).exit_status == "recording":
                raise FileError(str(run), *BEING_RECORDED, code="run.in_use")
            remedy = "retry when that program has finished"
            raise FileError(str(run), "is being changed by a different program", remedy, code="run.in_use")
        try:
            yield
        finally:
            durable.close(lock)
    except OSError as error:
        problem = f"cannot be {changed}: {error.strerror or error}"
        remedy = "run the command as the owner of the run, with enough disk space"
        raise CellError(str(run), problem, remedy, code="output.not_writable") from None


def relabel(
    run: Path,
    *,
    test: TestName | None = None,
    direction: Direction | None = None,
    operator: str | None = None,
    placement: str | None = None,
) -> Manifest:
    """Change labels of a run durably and atomically. None leaves a field unchanged.

    A test without a circle removes the direction.
    """
    load_manifest(run)
    with _locked(run, "relabelled"):
        manifest = load_manifest(run)
        if manifest.exit_status == "recording" or any(run.glob("*.arrow")):
            problem = "was not closed: the recording crashed"
            raise FileError(str(run), problem, to_recover(run), code="run.in_use")
        changed = _relabelled(run, manifest, test, direction, operator, placement)
        if changed != manifest and changed.version == 1:
            changed.save(run)
        elif changed != manifest:
            ledger = Ledger.resume(run)
            try:
                ledger.append(LedgerEntry(relabelled=changed.relabelled[len(manifest.relabelled) :]))
            finally:
                ledger.close()
    return changed


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
        words["operator"] = check_operator(operator)
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
        raise UseError(str(run), first_error(error), PLACEMENT_RULE, code="usage") from None


def _test_and_direction(
    run: Path, manifest: Manifest, test: TestName, direction: Direction | None
) -> dict[str, str | None]:
    # Recorded streams fit all tests with gauges. A table of a circle fits yaw and roll.
    alike: tuple[TestName, ...] = get_args(DrivenTest) if manifest.table is None else CIRCLES
    if test != manifest.test and not (manifest.test in alike and test in alike):
        problem = f"contains data of a {manifest.test} test, which cannot be relabelled as a {test} test"
        raise FileError(str(run), problem, f"import the data with --test {test}", code="readings.unsuitable")
    if test not in CIRCLES:
        if direction is not None:
            problem = f"a {test} test does not have a direction"
            raise UseError("--direction", problem, "leave --direction out", code="usage")
        return {"test": test, "direction": None}
    if (direction or manifest.direction) is None:
        problem = f"a {test} test needs a direction, which this run does not have"
        raise FileError(str(run), problem, "add --direction acw or cw", code="answer.missing")
    if manifest.table is not None and direction not in (None, manifest.direction):
        # The rows of a table also contain the direction, and tables are never changed.
        problem = f"contains an imported table with the direction {manifest.direction} in its rows"
        remedy = f"import the table with --direction {direction} and without the direction column"
        raise FileError(str(run), problem, remedy, code="readings.unsuitable")
    return {"test": test, "direction": direction or manifest.direction}
