"""Fixtures of the tests of the blind trial."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def blind_root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Directory of the cases, which all tests share."""
    return tmp_path_factory.mktemp("blind")
