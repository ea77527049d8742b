import numpy as np
import pytest

from analysis.diagnosis.diagnose import diagnose
from analysis.diagnosis.evidence.observation import by_socket, observe
from analysis.diagnosis.evidence.setups import columns_of, fit_setups
from analysis.procedures.touch import evaluate
from analysis.robot.predict import model_of
from rigs.arms import load_arm
from rigs.load import parse
from rigs.schema.effect import name_of
from tests.worlds.arms.seven_axes import Fault, draw_truth, run_of, touch_table

BALL_MM = np.array([10.0, -5.0, 120.0])
PLAY = Fault("play", 4, 0.12)


@pytest.fixture(scope="module")
def rig():
    return parse(f"name: seven\n{load_arm('franka-fr3').text}tests: {{touch: {{sockets: [A, B]}}}}\n", "seven.yaml")


@pytest.fixture(scope="module")
def run(rig):
    rng = np.random.default_rng(21)
    truth = draw_truth(rig.robot, rng, (PLAY,))
    return run_of(rig, touch_table(rig.robot, truth, rng, BALL_MM, 2, 35))


@pytest.fixture(scope="module")
def found(rig, run):
    return diagnose(rig, [run], [], [], lambda _: None)


def test_a_play_is_named_by_the_sides_from_which_the_joint_came(found):
    (play,) = found.standing
    assert name_of(play.effect) == "backlash 4"
    assert play.effect.width_deg == pytest.approx(PLAY.size, abs=3 * play.sd["width_deg"])
    assert play.sd["width_deg"] < 0.15 * PLAY.size


def test_the_calibrated_model_leaves_the_scatter(found):
    assert found.train.before_um > 400
    assert found.train.calibrated_um < 120
    assert set(found.calibrated.setups) == {"touch, socket A", "touch, socket B"}


def test_invisible_effect_is_no_likely_member(found):
    members = [name_of(member.effect) for part in found.budget for member in part.members]
    assert members and not {*members} & {*found.not_testable}


def test_each_socket_has_a_place_and_all_share_the_ball(rig, run):
    model = model_of(rig)
    pieces = by_socket(observe(model, run.table, "seven"))
    assert [one.setup for one in pieces] == ["touch, socket A", "touch, socket B"]
    assert columns_of({one.setup: one.table for one in pieces}) == {
        "touch, socket A": [0, 1, 2, 3, 4, 5],
        "touch, socket B": [6, 7, 8, 3, 4, 5],
    }
    placed = fit_setups(pieces)
    ours = evaluate(run.table, model)
    for one in pieces:
        setup = placed[one.setup]
        np.testing.assert_allclose(setup.T_tool_target[:3, 3], ours.ball_mm, atol=1e-3)
        np.testing.assert_allclose(-setup.T_instrument_world[:3, 3], ours.sockets_mm[one.setup[-1]], atol=1e-3)
