"""What the unexplained part follows: a joint if a cause does, nothing in plain noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.apps.report.act_words import ActWords
from analysis.apps.report.summary_words import summarise
from analysis.apps.report.texts import keys_of
from analysis.diagnosis.judge.dependence import held_out_share
from analysis.diagnosis.judge.residuals import Dependence, Residual
from analysis.diagnosis.judge.result import Diagnosis
from analysis.robot.kinematics.arm import Array
from analysis.runs.tables import CircleTable
from rigs.load import load
from tests.support.diagnosis_cells import circles, found_in
from tests.support.handmade_diagnosis import diagnosis
from tests.support.pose_runs import pose_run
from tests.worlds.arms.independent_arm import cell, none, postures


def _found(count: int, noise_mm: float, *, wander: float = 0.0, seed: int = 1) -> Diagnosis:
    """The diagnosis of poses of a sound UR10e in plain noise, with a zero of axis 2 that wanders by so many degrees."""
    rng = np.random.default_rng(seed)
    q = postures("ur10e", count, rng)
    turned = q.copy()
    turned[:, 1] += np.radians(wander) * np.cumsum(rng.normal(0, 0.3, count))
    seen = cell("ur10e", none(), rng).seen(turned, rng)
    places: Array = seen.xyz_mm + rng.normal(0, noise_mm, seen.xyz_mm.shape)
    return found_in([pose_run("ur10e", q, places)], load("ur10e")[0])


@pytest.mark.parametrize("seed", [1, 2])
def test_plain_noise_is_scatter_and_not_an_unknown_cause(seed: int) -> None:
    """0.25 mm of noise, no target visited twice: it was an unknown cause that makes 94 % of the error."""
    found = _found(40, 0.25, seed=seed)
    assert found.condition == "nothing_unusual"
    assert found.residual.scatter_um == pytest.approx(250, rel=0.2)
    size_mm = np.sqrt(3) * found.residual.scatter_um / 1e3  # the distance of a place, like the error beside it
    headline = summarise(found).headline
    assert keys_of(headline)[0] == "finding_scatter" and f"{size_mm:.2f} mm" in headline
    assert size_mm == pytest.approx(found.accuracy.now_um / 1e3, rel=0.1)
    assert found.acts[0].why == "revisit"
    assert not any(part.kind == "unexplained" for part in found.budget)
    assert sum(part.share for part in found.budget) == pytest.approx(1)


def test_deviations_beyond_usual_scatter_may_be_an_unknown_error_unless_targets_are_repeated() -> None:
    """Robots and trackers scatter by about 60 µm rms; 0.045 mm in each coordinate is more."""
    usual, unusual = _found(40, 0.02), _found(40, 0.045)
    assert usual.residual.unrepeated_um is None
    assert unusual.residual.unrepeated_um is not None
    assert unusual.residual.unrepeated_um == pytest.approx(np.sqrt(3) * 45, rel=0.3)
    assert unusual.condition == "undecided" and not unusual.standing
    summary = summarise(unusual)
    assert keys_of(summary.badge) == ("badge_undecided",) and keys_of(summary.headline)[0] == "finding_unrepeated"
    assert unusual.acts[0].why == "revisit"


def test_repeated_circles_that_differ_are_reported_first() -> None:
    differ = diagnosis("undecided", residual=Residual(0.0, visits_um=43.0))
    (first, *_) = summarise(differ).unknowns
    assert keys_of(first)[0] == "finding_repeats_differ" and "43 µm" in first


@pytest.mark.parametrize(("signs", "sticks"), [((1.0, -0.6), True), ((1.0, 1.0), False)])
def test_gauges_that_differ_from_repeat_to_repeat_are_reported_first(signs: tuple[float, float], sticks: bool) -> None:
    """The readings have a sawtooth of 30 µm, with a different phase in each run.

    A ball joint that sticks moves the gauges in opposite directions. Movements of the tool move both equally.
    """
    runs = []
    for k, run in enumerate(circles(seed=7)):
        table = run.table
        assert isinstance(table, CircleTable)
        teeth = 30 * np.linspace(0, 1, len(table.g_mm)) + np.random.default_rng(k).uniform()
        off_mm = 0.03 * (teeth % 1 - 0.5)
        runs.append(replace(run, table=replace(table, g_mm=table.g_mm + off_mm[:, None] * np.array(signs))))
    found = found_in(runs)
    assert (found.residual.gauges_um is not None) is sticks
    if sticks:
        # 14 µm rms in the difference, less the part that the repeats have in common.
        assert found.residual.gauges_um and 5 < found.residual.gauges_um < 15
        assert keys_of(summarise(found).unknowns[0])[0] == "finding_gauges_differ"
        assert found.acts[0].why == "gauges_differ" and keys_of(ActWords(found).next)[0] == "act_gauges_differ"


def test_a_material_error_without_a_cause_is_stated_beside_the_causes() -> None:
    named = diagnosis("named")
    material = replace(named, residual=replace(named.residual, um=97.0, at_new_places=True, is_material=True))
    headline = summarise(material).headline
    assert "finding_unexplained_there" in keys_of(headline) and "97 µm" in headline
    assert not any("unexplained" in key for key in keys_of(summarise(named).headline))


def test_a_wandering_zero_scatters_where_a_table_states_no_times() -> None:
    """The order of rows is no evidence: repeats of some targets, which the act asks for, show the change with time."""
    found = _found(150, 0.03, wander=0.03)
    assert found.condition == "nothing_unusual"
    assert found.residual.scatter_um is not None and found.residual.scatter_um > 5 * 30
    assert all(followed.share < 0.06 for followed in found.residual.follows)
    assert found.acts[0].why == "revisit"


def _visited_twice(turned_deg: Array, q: Array, noise_mm: float = 0.02, seed: int = 5) -> Diagnosis:
    """Diagnose poses of a sound UR10e, each visited twice, with an error of axis 2 in degrees at each of the visits."""
    rng = np.random.default_rng(seed)
    off = q.copy()
    off[:, 1] += np.radians(turned_deg)
    seen = cell("ur10e", none(), rng).seen(off, rng)
    places: Array = seen.xyz_mm + rng.normal(0, noise_mm, seen.xyz_mm.shape)
    return found_in([pose_run("ur10e", q, places)], load("ur10e")[0])


def test_visits_that_differ_come_first() -> None:
    """Warming or slip between two visits: a scatter of 0.03° of axis 2, and none, on the same postures."""
    q = np.tile(postures("ur10e", 30, np.random.default_rng(4)), (2, 1))
    quiet = _visited_twice(np.zeros(60), q)
    assert quiet.residual.visits_um is None
    found = _visited_twice(np.random.default_rng(6).normal(0, 0.03, 60), q)
    assert found.residual.visits_um is not None
    assert found.residual.visits_um > 100
    assert keys_of(summarise(found).unknowns[0])[0] == "finding_repeats_differ_places"
    assert found.acts[0].why == "visits_differ"
    assert keys_of(ActWords(found).next)[0] == "act_repeats_differ_places"


def test_an_error_that_a_model_misses_at_other_places_is_unexplained() -> None:
    """A cable that pulls once three joints are far out repeats, but no neighbourhood predicts the next."""
    q = np.tile(postures("ur10e", 50, np.random.default_rng(7)), (2, 1))
    pull = 0.04 * np.maximum(np.sin(q[:, 2]) * np.sin(2 * q[:, 3]) * np.cos(q[:, 4]), 0) * np.sign(np.sin(5 * q[:, 5]))
    found = _visited_twice(pull, q)
    assert found.condition == "outside_library" and found.residual.share > 0.05
    assert not found.standing


def test_the_share_of_noise_is_about_zero_and_that_of_a_cause_its_size() -> None:
    rng = np.random.default_rng(3)
    columns, noise, groups = rng.normal(size=(200, 8)), rng.normal(size=200), np.repeat(np.arange(20), 10)
    assert held_out_share(columns, noise, groups) < 0.05
    caused = columns @ rng.normal(size=8)
    caused *= 2 / caused.std()
    assert held_out_share(columns, caused + noise, groups) == pytest.approx(0.8, abs=0.08)


def test_the_joint_is_named_in_the_first_sentences() -> None:
    residual = Residual(110.0, follows=(Dependence("angle", 0.64, 2), Dependence("time", 0.05)))
    (*_, follows) = summarise(diagnosis("outside_library", residual=residual)).unknowns
    assert keys_of(follows)[:2] == ("finding_follows", "follows_angle") and "axis 2" in follows and "64 %" in follows
    nothing = Residual(110.0, follows=(Dependence("angle", 0.1, 2),))
    (*_, follows) = summarise(diagnosis("outside_library", residual=nothing)).unknowns
    assert keys_of(follows) == ("finding_follows_none",)
