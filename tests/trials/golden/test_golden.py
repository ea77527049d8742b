import copy
import math

import numpy as np
import pytest

from tests.trials.golden.golden import CASES, KEPT, LONG, changes, file_of, kept, made, normal


@pytest.mark.parametrize("case", [case for case in CASES if case.quick], ids=lambda case: case.name)
def test_output_equals_the_golden_files(case, tmp_path):
    said = made(case, tmp_path.resolve() / case.name)
    found = [one for one in changes(kept(case), said) if not one.is_of_processor]
    assert not found, "\n".join(map(str, found))


def test_every_case_is_kept_and_nothing_else_is():
    assert {file_of(case) for case in CASES} == set(KEPT.glob("*.json"))
    assert len({case.name for case in CASES}) == len(CASES)
    assert sum(file.stat().st_size for file in KEPT.glob("*.json")) < 1.15e6  # a tenth: what parts do alone


def test_change_is_judged_by_its_uncertainty():
    before = {"runs": [{"name": "lap", "figures": {"band_deg": {"value": 0.1, "u": 0.02}}}], "um": 3.0, "u_um": 0.5}
    now = copy.deepcopy(before)
    assert not list(changes(before, now))
    now["runs"][0]["figures"]["band_deg"]["value"] = 0.11
    now["um"] = 4.0
    band, um = changes(before, now)
    assert band.where == "runs[lap].figures.band_deg.value" and band.of_u and band.size == pytest.approx(0.5)
    assert um.of_u and um.size == pytest.approx(2.0) and "2 u" in str(um)


def test_items_are_compared_by_name_and_not_by_place():
    play, zero = {"name": "backlash 1", "um": 3.0}, {"name": "joint_offset 3", "um": 3.0}
    assert not list(changes({"budget": [play, zero]}, {"budget": [zero, play]}))
    (change,) = changes({"budget": [play, zero]}, {"budget": [zero, play | {"um": 3.001}]})
    assert change.where == "budget[backlash 1].um" and change.is_of_processor


def test_figure_without_u_is_judged_by_its_share():
    level, word, gone = changes({"level": 2.0, "condition": "named", "a": 1}, {"level": 1.0, "condition": "unnamed"})
    assert level.size == 0.5 and not level.of_u
    assert math.isinf(word.size) and "'named' → 'unnamed'" in str(word)
    assert gone.now == "(nothing)"


def test_digest_detects_an_exchange_and_ignores_paths_and_times(tmp_path):
    row = list(np.linspace(0.0, 1.0, LONG + 1))
    other = [*row[1:2], *row[:1], *row[2:]]
    assert normal(row, tmp_path) != normal(other, tmp_path)
    assert normal({"seconds": 3.0, "run": f"{tmp_path}/a", "um": 1.23456789}, tmp_path) == {"run": "a", "um": 1.23457}
