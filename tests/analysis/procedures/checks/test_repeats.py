from collections.abc import Collection
from dataclasses import replace

import pytest

from analysis.diagnosis.evidence.gather import prepare_runs
from analysis.procedures.checks.gauges import repeat_findings
from analysis.procedures.simulate import simulate
from analysis.runs.loading import Measured
from rigs.effects import Backlash
from tests.support.diagnosis_cells import RIG, circles, measured

PLAY = Backlash(axis=5, width_deg=0.3)


def _swapped(run: Measured) -> Measured:
    table = run.table
    return replace(run, table=replace(table, g_mm=table.g_mm[:, ::-1]))


def _with_swaps(runs: list[Measured], which: Collection[int]) -> list[Measured]:
    return [_swapped(run) if k in which else run for k, run in enumerate(runs)]


@pytest.mark.parametrize(
    ("test", "count", "which"), [("yaw", 3, [1]), ("roll", 3, [4]), ("yaw", 2, [3]), ("yaw", 3, [])]
)
def test_the_exchanged_run_is_found(test, count, which):
    runs = _with_swaps(circles((PLAY,), seed=41, count=count, tests=(test,)), which)
    assert [finding.meant for finding in repeat_findings(runs)] == ["g1 and g2 exchanged"] * len(which)
    assert [name for finding in repeat_findings(runs) for name in finding.runs] == [
        runs[k].run.manifest.name for k in which
    ]


def test_a_ball_on_the_other_side_is_not_an_exchange():
    x, y, z = RIG.tests.circle.eccentricity_mm
    circle = RIG.tests.circle.model_copy(update={"eccentricity_mm": (-x, -y, -z)})
    there = RIG.model_copy(update={"tests": RIG.tests.model_copy(update={"circle": circle})})
    runs = circles(seed=42, ways=("cw",))
    moved = measured(simulate(there, "yaw", "cw", 9), "yaw", "yaw-cw-9")
    assert list(repeat_findings([*runs, moved])) == []


def test_an_exchange_without_a_play_is_doubted():
    runs = circles(seed=44)
    _, doubts = prepare_runs(RIG, _with_swaps(runs, range(len(runs))))
    assert doubts[0].startswith("g1 and g2 may")


def _negated(run: Measured) -> Measured:
    table = run.table
    return replace(run, table=replace(table, g_mm=-table.g_mm))


def test_a_run_with_both_gauges_negated_is_found_among_its_repeats():
    runs = circles((PLAY,), seed=45, count=3)
    (found,) = repeat_findings([_negated(run) if k == 1 else run for k, run in enumerate(runs)])
    assert found.meant == "g1 and g2 negated" and found.runs == (runs[1].run.manifest.name,)
