"""What was done with a run after it had ended: `marks.json` beside the manifest, which it never changes.

A run is exported or kept for ever by a person's word; retention deletes nothing that is not exported, and nothing kept.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from daq.store import durable
from daq.store.manifest import load_manifest, unreadable
from daq.store.records import Text, first_error, iso_now
from rigs.errors import CellError, FileError
from rigs.files import of_newer_rig, read_bytes

MARKS = "marks.json"
_MOST_BYTES = 1_000_000


class Export(BaseModel):
    """One file that a run was written to, and when."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    at: str
    format: str
    file: Text


class Marks(BaseModel):
    """All marks of a run."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    version: Literal[1] = 1
    kept: bool = False
    exports: tuple[Export, ...] = ()


def load_marks(run: Path) -> Marks:
    """Return the marks of a run, empty if it was never marked. Raises FileError if they cannot be read."""
    path = run / MARKS
    try:
        return Marks.model_validate_json(read_bytes(path, _MOST_BYTES))
    except FileNotFoundError:
        return Marks()
    except ValidationError as error:
        if newer := of_newer_rig(str(path), error):
            raise newer from None
        raise FileError(str(path), f"is damaged: {first_error(error)}", "delete it, then mark the run again") from None
    except OSError as error:
        raise unreadable(path, error) from None


def mark_exported(run: Path, to: str, file: Path) -> None:
    """Note that a run was written to a file. Raises FileError, or CellError if this user may not write there."""
    export = Export(at=iso_now(), format=to, file=str(file.absolute()))
    _change(run, lambda marks: marks.model_copy(update={"exports": (*marks.exports, export)}))


def mark_kept(run: Path, kept: bool) -> None:
    """Note whether a run is kept for ever. Raises the errors of `mark_exported`."""
    _change(run, lambda marks: marks.model_copy(update={"kept": kept}))


def _change(run: Path, change: Callable[[Marks], Marks]) -> None:
    load_manifest(run)
    try:
        lock = durable.try_lock(run)
        if lock is None:
            raise FileError(
                str(run), "is being recorded or changed by another program", "try again when that has ended"
            )
        try:
            marks = change(load_marks(run))
            durable.replace(run / MARKS, marks.model_dump_json(indent=1).encode())
        finally:
            os.close(lock)
    except OSError as error:
        problem = f"cannot be marked: {error.strerror or error}"
        raise CellError(str(run), problem, "do it as the owner of the run, where there is room") from None
