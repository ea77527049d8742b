import numpy as np
import pytest
from scipy.signal import find_peaks

from analysis.apps.emulate.robot import trace
from analysis.robot.geometry.circle import frame_of, peaks, reversals
from analysis.robot.geometry.driven_programs import circle_laps, circle_of, circle_program, lap
from analysis.robot.kinematics.arm import arm_of, forward
from rigs.load import load, shipped
from tests.support.refusals import refused

RIGS = list(shipped())


@pytest.mark.parametrize("name", RIGS)
@pytest.mark.parametrize("direction", ["cw", "acw"])
def test_the_circle_is_driven_pose_by_pose_without_a_jump(name, direction):
    rig, _ = load(name)
    driven = trace(rig, direction)
    reached = forward(arm_of(rig.robot), driven.q)
    wanted = frame_of(circle_of(rig)).poses(driven.phi)
    assert np.abs(reached - wanted).max() < 1e-6
    assert np.abs(np.diff(driven.q, axis=0)).max() < np.radians(1)


@pytest.mark.parametrize("name", RIGS)
@pytest.mark.parametrize("direction", ["cw", "acw"])
def test_program_at_any_time_is_that_of_its_controller(name, direction):
    rig, _ = load(name)
    program, laps = circle_program(rig, direction), circle_laps(rig, direction)
    assert laps.count > 1
    assert laps.end_s == program.t_s[-1]
    t_s = np.concatenate([program.t_s, (program.t_s[1:] + program.t_s[:-1]) / 2])
    between = np.stack([np.interp(t_s, program.t_s, joint) for joint in program.q.T], axis=1)
    np.testing.assert_allclose(laps.at(t_s), between, rtol=0, atol=1e-12)


def test_reversals_of_the_papers_table_1():
    rig, _ = load("paper-fanuc")
    circle = circle_of(rig)
    turns = reversals(circle, arm_of(rig.robot), "paper-fanuc")
    paper = {(1, True): 105, (1, False): 237, (2, True): 3, (2, False): 182, (3, True): 351, (3, False): 169}
    paper |= {(5, True): 0, (5, False): 190, (6, True): 82, (6, False): 290}
    assert {(turn.axis, turn.upper) for turn in turns} == set(paper)
    for turn in turns:
        off = (np.degrees(turn.phi) - paper[turn.axis, turn.upper] + 180) % 360 - 180
        assert abs(off) < 1.5


@pytest.mark.parametrize("direction", ["cw", "acw"])
def test_lap_that_fits_the_limits_only_a_full_turn_away_begins_there(direction):
    rig, _ = load("ur10e-cell")
    circle = circle_of(rig)
    turned = circle.model_copy(update={"posture_deg": (*circle.posture_deg[:5], circle.posture_deg[5] - 360)})
    elsewhere = rig.model_copy(update={"tests": rig.tests.model_copy(update={"circle": turned})})
    np.testing.assert_allclose(circle_laps(elsewhere, direction).q, circle_laps(rig, direction).q, atol=1e-9)


def test_lap_that_fits_in_no_turn_is_refused():
    rig, _ = load("ur10e-cell")
    axes = (*rig.robot.axes[:5], rig.robot.axes[5].model_copy(update={"limits_deg": (-190.0, 190.0)}))
    narrow = rig.model_copy(update={"robot": rig.robot.model_copy(update={"axes": axes})})
    with refused("path.impossible", "beyond the limits"):
        circle_laps(narrow, "acw")


def test_too_fast_circle_is_refused():
    rig, _ = load("paper-fanuc")
    tests = rig.tests.model_copy(update={"circle": circle_of(rig).model_copy(update={"speed_mm_s": 500.0})})
    with refused("path.impossible", "s, but its limit is"):
        trace(rig.model_copy(update={"tests": tests}), "acw")


def test_a_lap_starts_and_ends_at_rest_and_holds_its_speed():
    circle = circle_of(load("paper-fanuc")[0])
    t, phi = lap(circle, "cw")
    speed = np.abs(np.diff(phi) / np.diff(t)) * circle.radius_mm
    assert speed[0] < 2 and speed[-1] < 2
    assert np.median(speed) == pytest.approx(circle.speed_mm_s, rel=1e-6)
    assert np.degrees(phi[0]) == pytest.approx(circle.start_deg + circle.lead_deg)
    assert np.degrees(phi[-1]) == pytest.approx(circle.start_deg - 360 - circle.lead_deg)


@pytest.mark.parametrize("seed", range(20))
def test_peaks_are_those_of_scipy(seed):
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.normal(size=400))
    for prominence in (0.5, 2.0, 5.0, 100.0):
        np.testing.assert_array_equal(peaks(x, prominence), find_peaks(x, prominence=prominence)[0])


def test_a_flat_top_is_at_its_middle():
    x = np.array([0.0, 1.0, 3.0, 3.0, 3.0, 2.0, 0.0])
    assert peaks(x, 1.5).tolist() == find_peaks(x, prominence=1.5)[0].tolist() == [3]
