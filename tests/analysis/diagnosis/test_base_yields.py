from dataclasses import replace

import numpy as np
import pytest

from analysis.procedures.shared.test_kind import path_of
from analysis.robot.predict import model_of, moved
from analysis.runs.tables import PoseTable
from rigs.arms import load_arm
from rigs.effects import BaseSags, BaseYields, Effect
from rigs.load import parse
from rigs.rig import Rig
from tests.worlds.arms.seven_axes import Array, Truth, draw_postures, draw_truth
from tests.worlds.arms.yielding_base import OnStand, Stand

BALL_MM = np.array([10.0, -5.0, 120.0])
CELL = f"name: cell\n{load_arm('ur10e').text}  payload_kg: 3\n"


@pytest.fixture(scope="module")
def rig():
    return parse(CELL, "cell.yaml")


def _perfect(rig: Rig) -> Truth:
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
def test_a_base_moves_the_tool_as_a_column_on_anchors_does(rig, stand, effects):
    q = draw_postures(rig.robot, np.random.default_rng(2), 30)
    really = OnStand(rig.robot, _perfect(rig), stand).places(q, q, BALL_MM)
    bare = _moved(rig, [], q)
    assert np.abs(really - bare).max() > 0.2
    # 1 ‰ for g, and what two small turns do that one after the other does otherwise.
    np.testing.assert_allclose(_moved(rig, effects, q), really, atol=1.5e-3 * float(np.abs(really - bare).max()))
