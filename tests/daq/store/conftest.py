import shutil
from pathlib import Path

import pytest

from tests.support.store_cases import finished


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished(tmp_path_factory.mktemp("runs"))


@pytest.fixture
def run(whole: Path, tmp_path: Path) -> Path:
    """A complete run of 20 rows in chunks of 8, alone in its directory, to be damaged; a copy, so runs are portable."""
    return Path(shutil.copytree(whole, tmp_path / "runs" / whole.name))
