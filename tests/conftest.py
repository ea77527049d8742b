"""What every process of the tests begins with."""

from __future__ import annotations

import gc

import pytest

gc.set_threshold(100_000)
"""As the command `rig` has it: looking through 6600 collected tests every few hundred objects costs a tenth to a third
of the processor time that collecting and quick tests take (14.1 s for 9.5 s of collecting, measured)."""


def pytest_collection_finish(session: pytest.Session) -> None:
    """Leave what has been collected out of every later search: it stays until the end."""
    gc.freeze()
