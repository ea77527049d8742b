"""`scripts/dev mutants`: each change is of code that computes, in its place, and is found where a test fails."""

import ast
from pathlib import Path

import pytest

from scripts.tools import mutants as program
from tests.support.durations import Durations
from tests.support.mutants import Mutant, drawn, files_for, mutants_of

ROOT = Path(__file__).parents[1]
CODE = '''"""A page of 3 lines."""
from __future__ import annotations

LIMIT = 2.5  # µm


def one(at: int = 0, *, is_on: bool = True) -> float | None:
    """Return 7."""
    if at < LIMIT:
        return LIMIT * (at + 1)
    if "é" not in "x" and is_on:
        raise ValueError(f"{at + 3}")
    return None
'''


def test_mutants_change_computing_code_and_stay_valid():
    found = {(one.line, one.kind, one.before, one.after) for one in mutants_of(CODE, "rigs/it.py")}
    assert found == {
        (4, "constant changed", "2.5", "5.0"),
        (7, "constant changed", "0", "1"),
        (7, "constant changed", "True", "False"),
        (9, "condition negated", "at < LIMIT", "(not (at < LIMIT))"),
        (9, "comparison flipped", "<", ">="),
        (10, "return removed", "return LIMIT * (at + 1)", "return None"),
        (10, "operator swapped", "*", "/"),
        (10, "operator swapped", "+", "-"),
        (10, "constant changed", "1", "2"),
        (11, "condition negated", '"é" not in "x" and is_on', '(not ("é" not in "x" and is_on))'),
        (11, "comparison flipped", "not in", "in"),
    }
    for one in mutants_of(CODE, "rigs/it.py"):
        changed = one.applied(CODE)
        assert changed != CODE and ast.parse(changed)
    with pytest.raises(ValueError, match="line 4"):
        Mutant("rigs/it.py", 4, 0, "2.5", "5.0", "constant changed").applied(CODE)


def test_the_same_seed_draws_the_same_of_each_package(tmp_path):
    for name in ("rigs", "daq", "analysis"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "it.py").write_text(CODE)
    few = drawn(tmp_path, 5, 3)
    assert few == drawn(tmp_path, 5, 3) and few != drawn(tmp_path, 5, 4)
    every = drawn(tmp_path, 1000, 3)
    assert every[:5] == few and {one.path for one in every} == {"rigs/it.py", "daq/it.py", "analysis/it.py"}


def test_specific_tests_come_before_importing_and_folder_tests():
    files = files_for(ROOT, "analysis/procedures/pose.py")
    assert files[0] == "tests/analysis/procedures/test_pose.py" and len(files) == len(set(files))
    of_folder, importing = "tests/analysis/procedures/test_touch.py", "tests/analysis/diagnosis/test_rail.py"
    assert files.index(importing) < files.index(of_folder)


def test_first_fitting_files_are_chosen_and_at_least_one():
    took = Durations({"a::x": 4.0, "a::y": 4.0, "b::x": 3.0, "c::x": 1.0, "d::x": 50.0}, {}, {"d::x"})
    assert program.within(["a", "b", "c"], took, 9.0, night=False) == ["a", "c"]
    assert program.within(["a", "b"], took, 1.0, night=False) == ["a"]
    assert program.within(["d"], took, 1.0, night=True) == ["d"]


def test_mutant_is_found_by_its_test_and_the_file_restored(tmp_path):
    (tmp_path / "rigs").mkdir()
    (tmp_path / "rigs" / "__init__.py").touch()
    (tmp_path / "tests" / "rigs").mkdir(parents=True)
    module, text = tmp_path / "rigs" / "sums.py", "def added(a, b):\n    return a + b\n"
    module.write_text(text)
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = real_time\naddopts = --import-mode=importlib\n")
    (mutant,) = (one for one in mutants_of(text, "rigs/sums.py") if one.kind == "operator swapped")
    own = "tests/rigs/test_sums.py"
    for number, found in ((0, {"by": "", "test": ""}), (1, {"by": "commit", "test": f"{own}::test_it"})):
        asserted = f"from rigs.sums import added\ndef test_it():\n    assert added(1, {number}) == {1 + number}\n"
        (tmp_path / own).write_text(asserted)
        assert program.looked_for(mutant, tmp_path, Durations(), 60.0, night=False) == found
        assert module.read_text() == text
    assert "1 mutants, 1" in program.counted([{**mutant.to_dict(), "by": "commit"}])
