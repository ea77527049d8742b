from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from analysis import diagnose
from analysis.apps.commission.what_moved import what_moved_in
from analysis.diagnosis.evidence.setups import fit_run_setups
from analysis.diagnosis.judge.result import Diagnosis
from analysis.movement.between import without_moved
from analysis.movement.cause_odds import MOST_ODDS
from analysis.movement.causes import Cause
from analysis.movement.inference import compare
from analysis.movement.linearise import _moved_thing  # private: a diagnosis of many targets takes long
from analysis.runs.loading import Measured
from rigs.errors import FileError
from rigs.load import load
from tests.support.diagnosis_cells import poses, seen
from tests.support.handmade_diagnosis import diagnosis
from tests.support.moved_cell import Case, label, observed
from tests.support.pose_runs import cell_with, pose_run
from tests.support.shipped_cells import cell_name
from tests.worlds import moved as world
from tests.worlds.arms.independent_arm import constants_of, flange, none

STATES: dict[str, tuple[str, list[dict[int, float]]]] = {
    "one zero, three homings": ("ur10e", [{}, {4: 0.17}, {4: -0.29}]),
    "two zeros at once": ("paper-fanuc", [{}, {2: 0.12, 4: -0.15}]),
    "a zero, then the base": ("paper-fanuc", [{}, {3: 0.15}, {0: 1.2}]),
}


@pytest.mark.parametrize(("arm", "changes"), STATES.values(), ids=STATES)
def test_changes_between_runs_are_movements_of_one_arm_state(arm, changes):
    cell = cell_with(arm, changes, np.random.default_rng(11))
    kept, movements, _ = without_moved(load(cell_name(arm))[0].model_copy(update={"effects": ()}), cell.runs)
    true = {(f"run_{k}", axis): size for k, change in enumerate(changes, start=1) for axis, size in change.items()}
    assert {(one.to, one.axis or 0) for one in movements} == set(true)
    sizes = {(one.to, one.axis): one.size_deg for one in movements if one.axis}
    assert sizes == pytest.approx({key: size for key, size in true.items() if key[1]}, abs=0.03)
    starts = [k for k, change in enumerate(changes) if change.keys() - {0}]
    states = {sum(int(run.run.manifest.name[-1]) > start for start in starts) for run in kept}
    assert len(states) == 1


def test_runs_of_an_unchanged_arm_stay_together():
    cell = cell_with("ur10e", [{}] * 3, np.random.default_rng(12))
    kept, movements, doubts = without_moved(load("ur10e-cell")[0].model_copy(update={"effects": ()}), cell.runs)
    assert len(kept) == 3 and not movements and not doubts


def test_a_diagnosis_gets_the_state_with_most_readings(monkeypatch):
    searched: list[str] = []

    def diagnosed(_: object, runs: list[Measured], *others: object) -> Diagnosis:
        searched.extend(run.run.manifest.name for run in runs)
        return diagnosis("nothing_unusual", acts=())

    monkeypatch.setattr("analysis.diagnosis.diagnose.diagnose", diagnosed)
    cell = cell_with("ur10e", [{}, {4: 0.17}, {}], np.random.default_rng(13))
    found = diagnose(cell.runs)
    assert searched == ["run_2", "run_3"]
    assert [(one.to, one.axis) for one in found.movements] == [("run_2", 4)]
    assert found.acts[0].why == "moved"


REFERENCES: dict[str, tuple[str, list[dict[int, float]], set[tuple[str, int | None]]]] = {
    "a zero, then another one": ("ur10e", [{}, {4: 0.17}, {}, {3: 0.1}], {("zero", 4)}),
    "the tool, then a zero": ("ur10e", [{}, {7: 1.2}, {}, {2: 0.1}], {("tool", None)}),
    "a zero and the base at once": ("ur10e", [{}, {5: 0.2, 0: 1.0}, {}], {("zero", 5), ("base", None)}),
    "references of one state": ("ur10e", [{}, {}, {3: 0.12}], set()),
}


@pytest.mark.parametrize(("arm", "changes", "among_references"), REFERENCES.values(), ids=REFERENCES)
def test_new_readings_are_compared_with_the_latest_state_of_the_reference(arm, changes, among_references):
    cell = cell_with(arm, changes, np.random.default_rng(14))
    rig = load(cell_name(arm))[0].model_copy(update={"effects": ()})
    found = what_moved_in(rig, cell.runs[:-1], cell.runs[-1:])
    assert {(one.what, one.axis) for one in found.reference_movements} == among_references
    first = 2 if among_references else 1
    assert found.reference_names == tuple(f"run_{k}" for k in range(first, len(changes)))
    named = {0: "base", 7: "tool"}
    expected = "+".join(named.get(axis, f"zero {axis}") for axis in changes[-1]) or "nothing"
    assert label(found.named.cause) == expected
    for axis, size in changes[-1].items():
        assert found.named.size_deg == (pytest.approx(size, abs=0.01) if axis in range(1, 7) else None)


def test_too_few_readings_of_the_latest_state_are_refused():
    cell = cell_with("ur10e", [{}, {3: 0.2}, {}], np.random.default_rng(15))
    cell.runs[1] = with_rows(cell.runs[1], 8)
    with pytest.raises(FileError) as error:
        what_moved_in(load("ur10e-cell")[0].model_copy(update={"effects": ()}), cell.runs[:2], cell.runs[2:])
    assert error.value.code == "readings.too_few" and error.value.where == "run_2"


def with_rows(run: Measured, count: int) -> Measured:
    table = run.table
    return replace(run, table=replace(table, q=table.q[:count], xyz_mm=table.xyz_mm[:count]))


@pytest.mark.parametrize("axes", [(2, 3, 4), (1, 3, 5)])
def test_three_zeros_that_moved_at_once_are_named_together(axes):
    drawn = Case(world.SIX, "nothing", 0.05, 601)
    zero = np.radians([0.1 * (axis in axes) for axis in range(1, 7)])
    drawn.change = replace(drawn.change, zero=zero)
    drawn.after = world.changed_arm(drawn.arm, drawn.change)
    assert label(drawn.named(drawn.touch_again(10))) == "+".join(f"zero {axis}" for axis in axes)


def test_odds_of_a_pair_include_a_third_part():
    drawn = Case(world.SIX, "zero 3+zero 4", 0.05, 602)
    probability = compare(drawn.reference, observed(drawn.model, *drawn.touch_again(10))).posterior.probability
    third = sum(p for cause, p in probability.items() if cause.what == "triple")
    pair = next(p for cause, p in probability.items() if label(cause) == "zero 3+zero 4")
    assert 1e-5 < third < 0.05 and pair > 0.95


def test_a_moved_target_moves_in_the_frame_of_the_tool():
    runs = seen([poses(1)])
    ((name, setup),) = fit_run_setups(runs)[0].items()
    shift_mm = np.array([0.3, -0.2, 0.5])
    moved = _moved_thing(setup, Cause("target", name=name), np.zeros(3), shift_mm)
    np.testing.assert_allclose(moved.T_tool_target[:3, 3] - setup.T_tool_target[:3, 3], shift_mm, atol=1e-12)
    np.testing.assert_array_equal(moved.T_tool_target[:3, :3], setup.T_tool_target[:3, :3])


RIG = load("ur10e-cell")[0].model_copy(update={"effects": ()})
TOOL_MM = np.array([40.0, 25.0, 130.0])


def _run(name: str, poses: int, *, base_mm: tuple[float, float, float] = (0, 0, 0), turn_deg: float = 0) -> Measured:
    """Poses of an arm with small errors; the base, or the zero of the first axis, differs from that at the start."""
    rng = np.random.default_rng([poses, *name.encode()])
    small = np.random.default_rng(4)
    wrong = replace(none(), a=small.normal(0, 0.1, 6), offset=np.radians(small.normal(0, 0.02, 6)))
    low, high = np.radians([(-85, -130, 50, -120, -110, -150), (85, -55, 120, -40, -50, 150)])
    q: NDArray[np.float64] = rng.uniform(low, high, (poses, 6))
    R, p = flange(constants_of("ur10e"), wrong, q + np.radians([turn_deg, 0, 0, 0, 0, 0]))
    places = p + R @ TOOL_MM + [2100.0, -800.0, 600.0] + base_mm + rng.normal(0, 0.02, (poses, 3))
    return pose_run("ur10e", q, places, name)


def test_zero_of_axis_1_and_rotated_base_are_indistinguishable():
    _, (movement,), _ = without_moved(RIG, [_run("before", 40), _run("after", 20, turn_deg=0.1)])
    assert (movement.what, movement.axis, movement.alike, movement.odds) == ("zero", 1, "base", MOST_ODDS)
