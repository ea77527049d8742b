"""Which files make a directory a run, and which of them are read."""

from __future__ import annotations

from collections.abc import Iterable

from daq.store.durable import TEMPORARY
from daq.store.ledger import LEDGER
from daq.store.manifest import MANIFEST, OF_A_RUN
from daq.store.marks import MARKS
from rigs.calibration import CALIBRATION

NO_RUNS = "lost+found"
"""What a file system puts at its top, for root alone."""
_CHUNKS = (".parquet", ".arrow")


def is_run(names: Iterable[str]) -> bool:
    """Whether files of these names make a directory a run, however damaged: one without a manifest may have its
    ledger."""
    return not OF_A_RUN.isdisjoint(names)


def has_figures(name: str) -> bool:
    """Whether figures follow from a file; marks, which say that a run was exported or is kept, change none."""
    return name in (MANIFEST, LEDGER) or name.endswith(_CHUNKS)


def is_read(name: str) -> bool:
    """Whether reading or verifying a run looks at a file."""
    return has_figures(name) or name == MARKS or name.endswith((TEMPORARY, CALIBRATION))
