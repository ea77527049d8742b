"""Registration of tests as packages: each layer imports only the part that it uses."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from analysis.diagnosis.evidence.observation_of import observation_of
from analysis.procedures.checks.checks_of_test import checks_of
from analysis.procedures.facts import shows_joints
from analysis.procedures.prediction import prediction_of
from analysis.procedures.shared.evaluate import evaluation_of
from analysis.runs.parts_of_tests import TESTS, package_of
from analysis.runs.table_format import format_of
from analysis.runs.tables import PathTable, PoseTable
from rigs.errors import FileError
from rigs.schema import vocabulary

ROOT = Path(__file__).parents[3]
FORMATS = """
import sys
from analysis.runs.parts_of_tests import TESTS
from analysis.runs.table_format import format_of
for test in TESTS:
    format_of(test)
print(*sorted(name for name in sys.modules if name.startswith("analysis.")))
"""


def test_rig_offers_each_of_its_tests() -> None:
    offers = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["entry-points"]
    assert tuple(offers["rig.tests"]) == TESTS
    for test in TESTS:
        assert package_of(test).__name__ == offers["rig.tests"][test]
        assert format_of(test).test == evaluation_of(test).test == checks_of(test).test == test


def test_a_format_is_read_without_the_other_parts() -> None:
    done = subprocess.run([sys.executable, "-c", FORMATS], capture_output=True, text=True, check=True, cwd=ROOT)
    loaded = set(done.stdout.split())
    packages = {package_of(test).__name__ for test in TESTS}
    assert {f"{package}.format" for package in packages} <= loaded
    parts = {f"{package}.{part}" for package in packages for part in ("predict", "evaluate", "checks", "observe")}
    assert not parts & loaded
    assert not {name for name in loaded if name.startswith(("analysis.procedures.checks", "analysis.diagnosis"))}
    assert all(find_spec(f"{package}.evaluate") for package in packages)


def test_a_test_without_joints_predicts_nothing() -> None:
    poses, path = PoseTable(np.zeros((1, 6)), np.zeros((1, 3)), None), PathTable(np.zeros(1), np.zeros((1, 3)))
    assert shows_joints("pose") and not shows_joints("path")
    assert prediction_of(poses).setup is not None and observation_of(poses).parts(poses) is None
    with pytest.raises(FileError, match="is a path without joint angles, which cannot show single joints"):
        prediction_of(path)


def test_an_installation_without_the_tests_says_how_to_add_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(vocabulary.TEST_PACKAGES, "yaw")
    package_of.cache_clear()
    with pytest.raises(FileError, match=r"does not offer it as rig\.tests; reinstall it"):
        package_of("yaw")
    package_of.cache_clear()
