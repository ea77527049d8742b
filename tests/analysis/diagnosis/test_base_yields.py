"""A base that gives way under the arm's moment, made by a stranger: it moves what the model moves, and is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.apps.report.texts import texts_of
from analysis.diagnosis.diagnose import diagnose
from analysis.diagnosis.judge.result import Diagnosis
from analysis.procedures.shared.test_kind import path_of
from analysis.robot.model.predict import model_of, moved
from analysis.runs.tables import PoseTable
from rigs.arms import load_arm
from rigs.effects import BaseSags, BaseYields, Effect
from rigs.load import parse
from rigs.rig import Rig
from rigs.schema.effect import name_of
from tests.support.answers import acts_in_words
from tests.worlds.arms.seven_axes import (
    Array,
    Fault,
    Truth,
    draw_postures,
    draw_truth,
    pose_table,
    run_of,
    touch_table,
)
from tests.worlds.arms.yielding_base import OnStand, Stand

BALL_MM = np.array([10.0, -5.0, 120.0])
CELL = f"name: cell\n{load_arm('ur10e').text}  payload_kg: 3\n"
CART = Stand(700, 8e-7, 8e-7, anchors=1.2e-6)
COLUMN = Stand(900, 6e-6, 1.5e-6, turned=0.5, sag=5e-5, firmer=0.1)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return parse(CELL, "cell.yaml")


def _perfect(rig: Rig) -> Truth:
    """An arm that is as its rig file says, on whatever it stands."""
    truth = draw_truth(rig.robot, np.random.default_rng(1), ())
    none = np.zeros(len(rig.robot.axes))
    off = replace(truth.off, a=none, alpha=none, d=none, zero=none)
    return replace(truth, soft=none, waves=(), play=none, off=off)


def _moved(rig: Rig, effects: list[Effect], q: Array) -> Array:
    model = model_of(rig, effects)
    path = path_of(model, PoseTable(q, np.zeros((len(q), 3)), None))
    T = path.at_readings(moved(model, path).T)
    return np.asarray(T[:, :3, 3] + T[:, :3, :3] @ BALL_MM)


@pytest.mark.parametrize(
    ("stand", "effects"),
    [
        (Stand(800, anchors=2e-6), [BaseYields(way="evenly", deg_per_Nm=np.degrees(2e-6), below_mm=800)]),
        (Stand(800, 2e-6, 2e-6), [BaseYields(way="evenly", deg_per_Nm=np.degrees(2e-6), below_mm=400)]),
        (Stand(600, 3e-6, 0.0), [BaseYields(way="x", deg_per_Nm=np.degrees(3e-6), below_mm=300)]),
        (Stand(600, 3e-6, 0.0, turned=0.75 * np.pi), [BaseYields(way="yx", deg_per_Nm=np.degrees(3e-6), below_mm=300)]),
        (
            Stand(600, 3e-6, 1e-6, turned=np.pi / 2, sag=1e-3),
            [
                BaseYields(way="evenly", deg_per_Nm=np.degrees(1e-6), below_mm=300),
                BaseYields(way="y", deg_per_Nm=np.degrees(2e-6), below_mm=300),
                BaseSags(way="y", mm_per_Nm=1e-3),
            ],
        ),
    ],
)
def test_a_base_moves_the_tool_as_a_column_on_anchors_does(rig: Rig, stand: Stand, effects: list[Effect]) -> None:
    q = draw_postures(rig.robot, np.random.default_rng(2), 30)
    really = OnStand(rig.robot, _perfect(rig), stand).places(q, q, BALL_MM)
    bare = _moved(rig, [], q)
    assert np.abs(really - bare).max() > 0.2
    # 1 ‰ for g, and what two small turns do that one after the other does otherwise.
    np.testing.assert_allclose(_moved(rig, effects, q), really, atol=1.5e-3 * float(np.abs(really - bare).max()))


def _found(rig: Rig, stand: Stand, seed: int, faults: tuple[Fault, ...] = ()) -> Diagnosis:
    rng = np.random.default_rng(seed)
    arm = OnStand(rig.robot, draw_truth(rig.robot, rng, faults), stand)
    return diagnose(rig, [run_of(rig, pose_table(rig.robot, arm, rng, BALL_MM, 150))], [], [], lambda _: None)


@pytest.mark.nightly  # 5 s
def test_a_cart_that_tilts_is_named_with_its_size_and_what_to_do(rig: Rig) -> None:
    found = _found(rig, CART, 1)
    (named,) = found.standing
    assert name_of(named.effect) == "base_yields evenly" and isinstance(named.effect, BaseYields)
    assert abs(named.effect.deg_per_Nm - np.degrees(2e-6)) < 2 * named.sd["deg_per_Nm"] < 2 * np.degrees(2e-6)
    for language, words in (("en", "Bolt the base"), ("de", "Den Sockel fest"), ("ko", "베이스를 단단히")):
        assert any(act.startswith(words) for act in acts_in_words(found, texts_of(language))), language


@pytest.mark.nightly  # 8 s
def test_a_column_is_named_by_the_lines_about_which_it_tilts_beside_a_fault_of_the_arm(rig: Rig) -> None:
    found = _found(rig, COLUMN, 6, (Fault("zero", 3, 0.3),))
    named = {name_of(one.effect): one for one in found.standing}
    truth = OnStand(rig.robot, _perfect(rig), COLUMN).tensor_deg()
    for way in ("x", "xy"):
        one = named[f"base_yields {way}"]
        assert isinstance(one.effect, BaseYields)
        assert abs(one.effect.deg_per_Nm - truth[way]) < 3 * one.sd["deg_per_Nm"] < 0.5 * truth[way]
    assert not any(name.startswith(("link_geometry", "compliance")) for name in named)


@pytest.mark.nightly  # 8 s
@pytest.mark.parametrize("faults", [(), (Fault("compliance", 2, 0.005),)])
def test_a_firm_pedestal_is_not_named_and_a_soft_joint_stays_one(rig: Rig, faults: tuple[Fault, ...]) -> None:
    found = _found(rig, Stand(600, 5e-8, 5e-8, anchors=5e-8), 2, faults)
    assert [name_of(one.effect) for one in found.standing] == [fault.name for fault in faults]


@pytest.mark.nightly  # 20 s
def test_touches_of_sockets_on_the_floor_show_a_base_that_tilts(rig: Rig) -> None:
    rng = np.random.default_rng(4)
    arm = OnStand(rig.robot, draw_truth(rig.robot, rng, ()), replace(COLUMN, turned=0.0))
    touched = parse(f"{CELL}tests: {{touch: {{sockets: [A, B, C, D]}}}}\n", "cell.yaml")
    table = touch_table(touched.robot, arm, rng, BALL_MM, 4, 80)
    found = diagnose(touched, [run_of(touched, table)], [], [], lambda _: None)
    assert any(one.effect.effect == "base_yields" for one in found.effects)
