"""Every effect of the vocabulary, and one that is written here, from the rig file to the correction."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import rigs.effects
from rigs.effects import VOCABULARY
from tests.support.effect_contract import STEPS


@pytest.mark.parametrize("name", VOCABULARY)
@pytest.mark.parametrize("step", STEPS, ids=lambda step: step.__name__)
def test_every_effect_keeps_the_contract(step: Callable[[str], None], name: str) -> None:
    step(name)


ROOT = Path(rigs.effects.__file__).parents[2]
NEW = '''\
"""A scale that is bent: a gauge reads too much by the square of its reading."""

from __future__ import annotations

from typing import Literal

from rigs.schema.effect import AT_GAUGE, Compensation, Effect, Gauge, Scope, at_each_gauge, size
from rigs.schema.scene import S


class GaugeBow(Effect):
    """A gauge reads `per_mm` of the square of its reading too much."""

    effect: Literal["gauge_bow"] = "gauge_bow"
    gauge: Gauge
    relative_per_mm: float = size(0.5, 1e-3)

    STAGE = "gauge"
    PLACE = AT_GAUGE

    def apply(self, scene: S) -> S:
        return scene.read(self.gauge, lambda g: g + self.relative_per_mm * g**2)

    @classmethod
    def forms(cls, scope: Scope) -> list[list[GaugeBow]]:
        return at_each_gauge(cls, scope)

    def plain(self, joint: str) -> str:
        return f"bow of gauge {self.gauge}"

    def remedy(self) -> str:
        return f"{self.gauge} bends: use the middle of its range"

    def compensation(self) -> Compensation:
        return Compensation("none", "is bent, and no arm can help")
'''


@pytest.fixture(scope="module")
def grown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The product with one more file in its folder of effects, as the first place that Python looks in."""
    root = tmp_path_factory.mktemp("grown")
    for package in ("rigs", "daq", "analysis"):
        shutil.copytree(ROOT / package, root / package, ignore=shutil.ignore_patterns("__pycache__"))
    (root / "rigs" / "effects" / "gauge_bow.py").write_text(NEW)
    return root


def _python(root: Path, *arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, *arguments],
        check=False,
        cwd=root,
        env=os.environ | {"PYTHONPATH": str(root)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def _rig(root: Path, *arguments: str) -> str:
    return _python(root, "-c", "from analysis.cli import main; main()", *arguments)


def test_a_new_file_is_an_effect_that_keeps_the_contract(grown: Path) -> None:
    _python(grown, str(ROOT / "tests" / "support" / "effect_contract.py"), "gauge_bow")


def test_a_new_effect_goes_through_every_command(grown: Path) -> None:
    hidden = grown / "hidden.yaml"
    planted = "effects: [{effect: gauge_bow, gauge: g1, relative_per_mm: 0.05}]"
    hidden.write_text(f"{planted}\neccentricity_mm: [0.6, -0.4, 0.1]\n")
    _rig(grown, "simulate", "paper-fanuc", "--test", "yaw", "-o", "sim", "--runs", "2", "--effects", str(hidden))
    runs = [str(path) for path in sorted((grown / "sim").iterdir())]
    fitted = json.loads(_rig(grown, "calibrate", *runs, "--fit", "gauge_bow:g1", "-o", "fitted.yaml", "--json"))
    assert "gauge_bow" in json.dumps(fitted)
    seen = json.loads(_rig(grown, "plan", "paper-fanuc", "--tests", "yaw", "--runs", "2", "--json"))
    assert {"gauge_bow g1", "gauge_bow g2"} <= {one["name"] for one in seen["effects"]}
    assert "bow of gauge g1" in _rig(grown, "diagnose", *runs, "-o", "found")
    (one,) = json.loads((grown / "found" / "diagnosis.json").read_text())["effects"]
    assert (one["name"], one["remedy"]) == ("gauge_bow g1", "g1 bends: use the middle of its range")
    assert abs(one["parameters"]["relative_per_mm"]["value"] - 0.05) < 0.005
    corrected = json.loads(_rig(grown, "correct", "found/paper-fanuc.yaml", "-o", "corrected", "--json"))
    assert corrected["effects"][0]["reason"] == "is bent, and no arm can help"
