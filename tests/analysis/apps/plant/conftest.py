"""Figures of a run are computed once per process: most tests of a plant read the same runs, in copies."""

import hashlib
from pathlib import Path

import pytest

from analysis.apps.plant import before_after, collect
from analysis.apps.plant.records import RunRecord, record_of
from daq.store import Manifest

_KNOWN: dict[tuple[str, str, str], RunRecord] = {}


@pytest.fixture(autouse=True)
def _records_by_content(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace `record_of` by one that remembers records by name, fingerprint and bytes of the run: a damaged run keeps
    the fingerprint of its ledger.
    """

    def known(path: Path, manifest: Manifest, fingerprint: str) -> RunRecord:
        key = path.name, fingerprint, _digest(path)
        if key not in _KNOWN:
            _KNOWN[key] = record_of(path, manifest, fingerprint)
        return _KNOWN[key]

    monkeypatch.setattr(before_after, "record_of", known)
    monkeypatch.setattr(collect, "record_of", known)


def _digest(run: Path) -> str:
    found = hashlib.sha256()
    for file in sorted(file for file in run.rglob("*") if file.is_file()):
        found.update(file.name.encode() + file.read_bytes())
    return found.hexdigest()
