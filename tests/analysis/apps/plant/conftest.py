"""Figures of a run are computed once per process: most tests of a plant read the same runs, in copies."""

from pathlib import Path

import pytest

from analysis.apps.plant import before_after, collect
from analysis.apps.plant.records import RunRecord, record_of
from daq.store import Manifest

_KNOWN: dict[tuple[str, str], RunRecord] = {}


@pytest.fixture(autouse=True)
def _records_by_content(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace `record_of` by one that remembers records by the name of the run and the fingerprint of its content."""

    def known(path: Path, manifest: Manifest, fingerprint: str) -> RunRecord:
        key = path.name, fingerprint
        if key not in _KNOWN:
            _KNOWN[key] = record_of(path, manifest, fingerprint)
        return _KNOWN[key]

    monkeypatch.setattr(before_after, "record_of", known)
    monkeypatch.setattr(collect, "record_of", known)
