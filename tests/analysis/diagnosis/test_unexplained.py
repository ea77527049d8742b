from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.judge.dependence import held_out_share
from analysis.diagnosis.judge.result import Diagnosis
from analysis.robot.kinematics.arm import Array
from analysis.runs.tables import PoseTable
from rigs.load import load
from tests.support.diagnosis_cells import circles, found_in, measured
from tests.support.pose_runs import pose_run
from tests.worlds.arms import independent_arm
from tests.worlds.arms.independent_arm import cell, none, postures


def _found(count: int, noise_mm: float, *, wander: float = 0.0, seed: int = 1) -> Diagnosis:
    """The diagnosis of poses of a sound UR10e in plain noise, with a zero of axis 2 that wanders by so many degrees."""
    rng = np.random.default_rng(seed)
    q = postures("ur10e", count, rng)
    turned = q.copy()
    turned[:, 1] += np.radians(wander) * np.cumsum(rng.normal(0, 0.3, count))
    seen = cell("ur10e", none(), rng).seen(turned, rng)
    places: Array = seen.xyz_mm + rng.normal(0, noise_mm, seen.xyz_mm.shape)
    return found_in([pose_run("ur10e", q, places)], load("ur10e-cell")[0])


def test_plain_noise_is_scatter_and_not_an_unknown_cause():
    found = _found(40, 0.25)
    assert found.condition == "nothing_unusual"
    assert found.residual.scatter_um == pytest.approx(250, rel=0.2)
    size_mm = np.sqrt(3) * found.residual.scatter_um / 1e3  # the distance of a place, like the error beside it
    assert size_mm == pytest.approx(found.accuracy.now_um / 1e3, rel=0.1)
    assert found.acts[0].why == "revisit"
    assert not any(part.kind == "unexplained" for part in found.budget)
    assert sum(part.share for part in found.budget) == pytest.approx(1)


@pytest.mark.nightly
def test_deviations_of_usual_scatter_need_no_repeated_targets():
    assert _found(40, 0.02).residual.unrepeated_um is None


def test_deviations_beyond_usual_scatter_may_be_an_unknown_error_unless_targets_are_repeated():
    """Robots and trackers scatter by about 60 µm rms; 0.045 mm in each coordinate is more."""
    unusual = _found(40, 0.045)
    assert unusual.residual.unrepeated_um == pytest.approx(np.sqrt(3) * 45, rel=0.3)
    assert unusual.condition == "undecided" and not unusual.standing
    assert unusual.acts[0].why == "revisit"


def test_gauges_that_differ_from_repeat_to_repeat_are_reported_first():
    """The readings have a sawtooth of 30 µm, with a different phase in each run.

    A ball joint that sticks moves the gauges in opposite directions. Movements of the tool move both equally.
    """
    runs = []
    for k, run in enumerate(circles(seed=7)):
        table = run.table
        teeth = 30 * np.linspace(0, 1, len(table.g_mm)) + np.random.default_rng(k).uniform()
        off_mm = 0.03 * (teeth % 1 - 0.5)
        runs.append(replace(run, table=replace(table, g_mm=table.g_mm + off_mm[:, None] * np.array([1.0, -0.6]))))
    found = found_in(runs)
    # 14 µm rms in the difference, less the part that the repeats have in common.
    assert 5 < found.residual.gauges_um < 15
    assert found.acts[0].why == "gauges_differ"


def _visited_twice(turned_deg: Array, q: Array) -> Diagnosis:
    rng = np.random.default_rng(5)
    off = q.copy()
    off[:, 1] += np.radians(turned_deg)
    seen = cell("ur10e", none(), rng).seen(off, rng)
    places: Array = seen.xyz_mm + rng.normal(0, 0.02, seen.xyz_mm.shape)
    return found_in([pose_run("ur10e", q, places)], load("ur10e-cell")[0])


def test_visits_that_differ_come_first():
    q = np.tile(postures("ur10e", 20, np.random.default_rng(4)), (2, 1))
    found = _visited_twice(np.random.default_rng(6).normal(0, 0.03, 40), q)
    assert found.residual.visits_um > 100
    assert found.acts[0].why == "visits_differ"


def test_the_share_of_noise_is_about_zero_and_that_of_a_cause_its_size():
    rng = np.random.default_rng(3)
    columns, noise, groups = rng.normal(size=(200, 8)), rng.normal(size=200), np.repeat(np.arange(20), 10)
    assert held_out_share(columns, noise, groups) < 0.05
    caused = columns @ rng.normal(size=8)
    caused *= 2 / caused.std()
    assert held_out_share(columns, caused + noise, groups) == pytest.approx(0.8, abs=0.08)


def test_too_few_poses_prove_no_unknown_cause_and_no_gain_of_a_correction():
    rng = np.random.default_rng(9)
    small = independent_arm.none()
    small = replace(
        small, a=rng.normal(0, 0.25, 6), d=rng.normal(0, 0.25, 6), offset=np.radians(rng.normal(0, 0.04, 6))
    )
    q = independent_arm.postures("ur10e", 12, rng)
    R, p = independent_arm.flange(independent_arm.constants_of("ur10e"), small, q)
    places = p + R @ [30.0, -20.0, 110.0] + [2500.0, -800.0, 400.0] + rng.normal(0, 0.02, (12, 3))
    rig = load("ur10e-cell")[0].model_copy(update={"effects": ()})
    found = found_in([measured(PoseTable(q, places, None), "pose", "few", rig)], rig)
    assert found.condition != "outside_library" and not found.residual.is_material
    # The other poses predict each of them better than the rig file, but another place comes before a correction.
    first = next(act for act in found.acts if act.kind in ("measure", "load"))
    assert (first.kind, first.why) == ("measure", "elsewhere")
