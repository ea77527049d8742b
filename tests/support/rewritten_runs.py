"""Runs whose manifest and ledger say something else than what was recorded, and still prove it."""

import json
from pathlib import Path
from typing import Any

from daq.store.ledger import LEDGER, Entry, lines_of, read_ledger
from daq.store.manifest import MANIFEST
from daq.store.records import sha256


def rewrite(run: Path, changes: dict[str, Any], reason: str) -> None:
    """Change fields of a run's manifest, and the reason of its end, and chain its ledger to them."""
    data = json.dumps(json.loads((run / MANIFEST).read_text()) | changes).encode()
    (run / MANIFEST).write_bytes(data)
    rest = [
        entry.model_copy(update={"seal": entry.seal.model_copy(update={"reason": reason})}) if entry.seal else entry
        for entry in read_ledger(run).entries[1:]
    ]
    (run / LEDGER).write_bytes(lines_of([Entry(opening=sha256(data)), *rest]))


def forget_chunks(run: Path) -> None:
    """Take the chunks and the seal out of a run's ledger: a crash came before they were noted."""
    kept = [entry for entry in read_ledger(run).entries if not entry.chunk and not entry.seal]
    (run / LEDGER).write_bytes(lines_of(kept))
