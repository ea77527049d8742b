"""A run that is new or has changed, as the catalogue keeps it: its record, and the rig file that it holds."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path

from analysis.batch.fetched import fetched, named
from analysis.history.collect import REASONS
from analysis.history.records import Record, fingerprint_of, record_of, record_without_figures
from daq.store.retention import RunInfo, look
from rigs.errors import FileError


@dataclass(frozen=True)
class Examined:
    """A run's record; rig_text: its rig file; is_evaluated: whether it was evaluated, so that it is examined again only
    where it has changed."""

    record: Record
    rig_text: str = ""
    is_evaluated: bool = True


def examine(path: Path) -> Examined | None:
    """Evaluate a run, or say why it cannot be; None where it is gone. Never raises for a bad run; raises RigError for
    one elsewhere that cannot be fetched."""
    with fetched(path) as directory:
        examined = _examined(directory)
    if examined is None:
        return None
    record = replace(examined.record, name=path.name, problem=named(examined.record.problem, directory, path))
    return replace(examined, record=record)


def _examined(path: Path) -> Examined | None:
    try:
        run = look(path)
    except OSError as error:
        if isinstance(error, FileNotFoundError) and not os.path.lexists(path):
            return None
        unreadable = RunInfo(path, None, None, "damaged", 0, 0.0)
        return Examined(record_without_figures(unreadable, error.strerror or str(error)), is_evaluated=False)
    if run.manifest is None or run.status in REASONS:
        return Examined(record_without_figures(run, REASONS[run.status]), _rig_text(run), is_evaluated=False)
    try:
        fingerprint = fingerprint_of(run.path)
    except (OSError, FileError) as error:
        return Examined(record_without_figures(run, str(error)), _rig_text(run), is_evaluated=False)
    return Examined(record_of(run.path, run.manifest, fingerprint), _rig_text(run))


def _rig_text(run: RunInfo) -> str:
    return run.manifest.rig_text if run.manifest else ""
