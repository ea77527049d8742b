"""The real world: its noise has the levels it says, its arms are as said, its oracle sees what can be seen."""

import filecmp
import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.nightly import cases
from tests.worlds import stranger
from tests.worlds.stranger.faults import Fault
from tests.worlds.stranger.real import noise as noises
from tests.worlds.stranger.real.cases import LAPS
from tests.worlds.stranger.real.oracle import Oracle
from tests.worlds.stranger.sight import REPEATS, sight_of


@cache
def oracle_of(white: float) -> Oracle:
    """UR10e in a cell whose levels are in the middle of the table, gauges `white` times as noisy."""
    rng = np.random.default_rng(9)
    sight = sight_of("ur10e-cell")
    numbers = tuple({int(k) for k in sight.targets["target"]})
    own = noises.Levels(
        np.full((8, 2), white * 1e-3), np.full(8, white * 3e-3), 0.5, 0.8, 1e-3, 4e-3, np.zeros(3),
        dict.fromkeys(numbers, 0.015),
    )  # fmt: skip
    return Oracle(sight, noises.drawn_cell(rng, "one", 50.0), dict.fromkeys(("yaw", "roll", "radial"), own), 2, LAPS)


def test_oracle_knows_invisible_and_indistinguishable_faults():
    """diagnosis-recipe.md, "Twins and the unseen": on a UR10e."""
    scale = Fault("gauge_scale", {"gauge": "g1"}, 0.02)
    (seen,) = oracle_of(1.0).look([scale], 1.0)
    assert "gauge_inclination g1" in seen.twins
    (geometry,) = oracle_of(1.0).look([Fault("link_geometry", {"axis": 1, "field": "d"}, 20.0)], 1.0)
    assert geometry.sigma < 1
    (turned,) = oracle_of(1.0).look([Fault("joint_offset", {"axis": 1}, 2.0)], 1.0)
    assert turned.sigma < 1
    (play,) = oracle_of(1.0).look([Fault("backlash", {"axis": 2}, 0.2)], 1.0)
    assert play.testable and not play.twins


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A case of a kind and seed, and its truth: each generated once."""

    @cache
    def case(kind: str, seed: int) -> tuple[Path, dict[str, Any]]:
        root = tmp_path_factory.mktemp(kind)
        path = stranger.generate_real(kind, seed, root, root / "truth")
        return path, json.loads((root / "truth" / f"{path.name}.json").read_text(encoding="utf-8"))

    return case


@pytest.mark.parametrize("kind", cases(stranger.REAL_KINDS, ("two", "foreign_third")))
def test_cases_have_their_kind(kind, made):
    case, truth = made(kind, 3)
    count = {"healthy": 0, "foreign_large": 0, "two": 2, "three": 3}.get(kind, 1)
    assert len(truth["hidden"]) == count
    assert len(truth["outside"]) == kind.startswith("foreign")
    for one in truth["hidden"]:
        assert one["times"] >= (8 if kind == "one_large" else 5) - 1e-6
        moved = one["worth_um"]
        assert any(um >= 0.8 * max(3.0, truth["scatter_um"][test]) for test, um in moved.items())
        assert one["name"] in one["class"]
    lines = [line.split(",") for line in (case / "runs.csv").read_text(encoding="utf-8").split()[1:]]
    uses = [(test, way, use) for _, test, way, use, _ in lines]
    for test in ("yaw", "roll"):
        assert all(uses.count((test, way, "train")) == REPEATS for way in ("acw", "cw"))
    assert uses.count(("repeatability", "", "train")) == 1 and 1 <= uses.count(("radial", "", "train")) <= 2
    assert sum(use == "held_out" for *_, use in uses) == sum(use == "unseen" for *_, use in uses) == 2


def test_a_case_is_fixed_by_kind_and_seed(made, tmp_path):
    first, _ = made("one", 3)
    second = stranger.generate_real("one", 3, tmp_path / "b", tmp_path / "t")
    names = sorted(path.name for path in first.iterdir() if path.is_file())
    assert filecmp.cmpfiles(first, second, names, shallow=False)[0] == names
