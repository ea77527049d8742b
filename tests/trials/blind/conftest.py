"""What tests of the blind trial share."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def blind_root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Directory of the cases. Existing cases are diagnosed again, but not generated again."""
    return tmp_path_factory.mktemp("blind")
