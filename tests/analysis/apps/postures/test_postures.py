"""All postures of a target, their expected errors by plain arithmetic, the best sequence, and the map of places.

The checks have kinematics of their own (`tests.worlds.arms.soft_arm`), and fit frame and tool by plain least squares.
"""

from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from analysis.apps.postures.candidates import LEAST_CONDITIONING, NO_BRANCH, Candidates, find_candidates
from analysis.apps.postures.expected_error import PostureErrors, expected_errors
from analysis.apps.postures.result import best_sequence, choose_postures, work_map
from analysis.robot.kinematics.arm import Array, arm_of, forward
from rigs.arms import load_arm
from rigs.calibration import TIMES, CovarianceParameter, Term, packed_factor
from rigs.effects import Backlash, Effect, JointOffset
from rigs.load import load, parse
from rigs.rig import Rig
from tests.support.handmade_calibration import calibrated_model
from tests.worlds.arms import soft_arm

POSTURE = np.radians([20.0, -70.0, 100.0, -60.0, -80.0, 30.0])
"""A posture of a UR10 in the middle of its work."""
SIZE_DEG, U_DEG = 0.2, 0.001
RNG = np.random.default_rng(3)


def ur10(*effects: Effect, reaches_deg: float = 360.0) -> Rig:
    """A UR10 whose tool is at the flange, with a calibration of effects that was measured up to an angle."""
    rig = load("ur10")[0]
    rig = rig.model_copy(update={"effects": (), "robot": rig.robot.model_copy(update={"tool": type(rig.robot.tool)()})})
    terms = tuple(Term(effect=effect, times=1.0) for effect in effects)
    parameters = tuple(CovarianceParameter(term=k, field=TIMES) for k in range(len(terms)))
    # the root of the covariance is in multiples of each effect
    factor = packed_factor(U_DEG / SIZE_DEG * np.eye(len(terms)))
    joints = ((-reaches_deg, reaches_deg),) * 6
    model = calibrated_model(rig="ur10", terms=terms, parameters=parameters, factor=factor, joints_deg=joints)
    return rig.with_calibration(None, model)


def about(posture: Array, count: int, deg: float = 40.0) -> Array:
    return posture + np.radians(RNG.uniform(-deg, deg, (count, len(posture))))


def test_every_posture_of_a_six_axis_arm_reaches_its_target():
    rig, plain = ur10(), soft_arm.nominal("ur10")
    flange = plain.frames(POSTURE[None])[:, -1]
    found = find_candidates(arm_of(rig.robot), forward(arm_of(rig.robot), POSTURE[None]), POSTURE)
    assert len(set(found.branch.tolist())) == 8
    assert np.abs(plain.frames(found.q)[:, -1] - flange).max() < 1e-6
    assert (np.abs(found.q) <= np.radians(360)).all()
    assert np.abs(found.q - POSTURE).max(axis=1).min() < 1e-9  # the posture itself is one of them


def test_why_a_target_has_no_posture():
    rig = ur10()
    arm = arm_of(rig.robot)
    poses = forward(arm, np.stack([POSTURE, np.radians([20.0, -70, 0, -60, -80, 30]), POSTURE]))
    poses[0, :3, 3] *= 10
    narrow = replace(arm, limits=np.radians([[-1.0, 1.0]] * 6))
    assert find_candidates(arm, poses, POSTURE).reasons == {0: "unreachable", 1: "singular"}
    assert find_candidates(narrow, poses[2:], POSTURE).reasons == {0: "beyond_limits"}


def test_a_seventh_axis_is_sampled():
    rig = parse(f"name: arm\n{load_arm('franka-fr3').text}", "x")
    arm = arm_of(rig.robot)
    q = np.radians([10.0, 20, -15, -100, 20, 110, 40])
    found = find_candidates(arm, forward(arm, q[None]), q)
    assert len(found.q) > 8
    assert np.abs(forward(arm, found.q) - forward(arm, q[None])).max() < 1e-6
    assert ((found.q >= arm.limits[:, 0]) & (found.q <= arm.limits[:, 1])).all()
    apart = np.abs(found.q[:, None] - found.q).max(axis=2) + np.eye(len(found.q))
    assert np.degrees(apart.min()) > 2.9  # samples differ for a person
    assert (found.branch == NO_BRANCH).all()


def _in_taught_frame(nominal: Array, seen: Array, at: Array, seen_at: Array) -> Array:
    """Displacements (m, 3) mm of places seen at (m, 3) from flanges (m, 4, 4), with the rotation, shift and tool that
    fit other places (n, 3) to flanges (n, 4, 4)."""

    def off(x: Array, T: Array, places: Array) -> Array:
        R = Rotation.from_rotvec(x[:3]).as_matrix()
        return np.asarray((places - x[3:6]) @ R - T[:, :3, :3] @ x[6:] - T[:, :3, 3])

    fitted = least_squares(lambda x: off(x, nominal, seen).ravel(), np.zeros(9), x_scale=[1e-3] * 3 + [1.0] * 6)
    return off(fitted.x, at, seen_at)


def test_error_of_a_zero_equals_that_in_a_taught_frame():
    rig, plain = ur10(JointOffset(axis=3, offset_deg=SIZE_DEG)), soft_arm.nominal("ur10")
    wrong = replace(plain, offset=plain.offset + np.radians(SIZE_DEG) * np.eye(6)[2])
    taught, asked = about(POSTURE, 60), about(POSTURE, 20)
    flanges = [plain.frames(q)[:, -1] for q in (taught, asked)]
    places = [wrong.frames(q)[:, -1, :3, 3] for q in (taught, asked)]
    off_mm = _in_taught_frame(flanges[0], places[0], flanges[1], places[1])
    errors = expected_errors(rig, asked, taught)
    assert errors.error_mm == pytest.approx(off_mm, abs=0.01)
    assert errors.size_mm.max() > 0.3
    assert errors.u_mm == pytest.approx(errors.size_mm * U_DEG / SIZE_DEG, rel=0.02, abs=1e-6)
    assert errors.covered.all()


def test_taught_frame_does_not_depend_on_the_order_of_the_grid():
    """Measured series repeat their orientations in order: every fourth pose alone would teach another frame."""
    rig = ur10(JointOffset(axis=3, offset_deg=SIZE_DEG))
    wrists = np.radians([[-60.0, -80, 30], [-60, 80, 30], [60, -80, 120], [60, 80, 120]])
    grid = np.array([[*about(POSTURE[:3], 1)[0], *wrist] for _ in range(200) for wrist in wrists])
    in_order, shuffled = (expected_errors(rig, grid[:8], taught) for taught in (grid, RNG.permutation(grid)))
    assert in_order.error_mm == pytest.approx(shuffled.error_mm, abs=1e-9)
    assert in_order.u_mm == pytest.approx(shuffled.u_mm, abs=0.15 * shuffled.u_mm.max())


def test_play_moves_the_tool_by_half_width_times_lever():
    """Cases known from physics: a tool near the faulty axis moves less, and a rising joint lags behind."""
    width = 0.1
    rig, plain = ur10(Backlash(axis=1, width_deg=width)), soft_arm.nominal("ur10")
    q = about(POSTURE, 12)
    errors = expected_errors(rig, q, about(POSTURE, 30))
    p = plain.frames(q)[:, -1, :3, 3]
    lever = np.hypot(p[:, 0], p[:, 1])
    assert errors.play_mm == pytest.approx(np.radians(width) / 2 * lever, rel=1e-6)
    onward = np.stack([-p[:, 1], p[:, 0], 0 * p[:, 0]], axis=1) / lever[:, None]
    assert (errors.rising_mm[:, 0] * onward).sum(axis=1) == pytest.approx(-np.radians(width) / 2 * lever, rel=1e-6)
    assert (np.argsort(errors.play_mm) == np.argsort(lever)).all()


def test_the_better_side_of_approach_takes_back_a_zero():
    play, zero = Backlash(axis=1, width_deg=0.1), JointOffset(axis=1, offset_deg=0.05)
    errors = PostureErrors(
        error_mm=np.array([[0.0, 1.0, 0.0]]),
        u_mm=np.array([0.1]),
        rising_mm=np.array([[[0.0, -1.0, 0.0], [0.0, 0.0, 0.0]]]),
        falling_mm=np.array([[[0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]]),
        covered=None,
    )
    assert play.width_deg == 2 * zero.offset_deg  # the figures above: a joint that rises lags by the zero
    rising, expected = errors.best_approach()
    assert rising[0, 0]
    assert expected[0] == pytest.approx(0.1)
    assert errors.from_sides(np.array([[-1.0, 1.0]]))[0] == pytest.approx(np.hypot(2.0, 0.1))
    assert errors.expected_mm[0] == pytest.approx(np.sqrt(1 + 1 + 0.01))


def test_u_grows_outside_the_measured_region():
    effect, taught = JointOffset(axis=3, offset_deg=SIZE_DEG), about(POSTURE, 30)
    inside = expected_errors(ur10(effect), POSTURE[None], taught)
    at_edge = expected_errors(ur10(effect, reaches_deg=99.0), POSTURE[None], taught)
    outside = expected_errors(ur10(effect, reaches_deg=40.0), POSTURE[None], taught)
    assert inside.u_mm[0] < at_edge.u_mm[0] < outside.u_mm[0] == pytest.approx(4 * inside.u_mm[0])
    assert not outside.covered[0]


def test_unmeasured_arm_has_typical_errors_with_a_remark():
    rig = parse(f"name: arm\n{load_arm('ur10').text}", "x")
    found = choose_postures(rig, forward(arm_of(rig.robot), about(POSTURE, 5)))
    assert found.knowledge == "typical"
    assert np.abs(found.errors.error_mm).max() < 1e-9
    assert 0.1 < np.median(found.errors.u_mm) < 2.0
    assert found.to_dict()["targets"][0]["postures"][0]["error_mm"] is None


def _random_program(changes: float) -> tuple[Candidates, PostureErrors]:
    rng = np.random.default_rng(int(10 * changes))
    q, branch = rng.uniform(-1, 1, (12, 2)), rng.integers(0, 3, 12)
    candidates = Candidates(q, np.repeat(np.arange(4), 3), np.arange(12), branch, np.ones(12), {})
    side = 0.3 * rng.normal(size=(12, 2, 3))
    errors = PostureErrors(rng.normal(size=(12, 3)), rng.uniform(0.1, 0.3, 12), side, -side, None)
    return candidates, errors


@pytest.mark.parametrize("change", [0.0, 0.5, 5.0])
def test_the_best_sequence_is_the_best_of_all(change):
    candidates, errors = _random_program(change)
    smallest = errors.expected_mm.reshape(4, 3).min(axis=1)
    unit = np.sqrt(np.mean(smallest**2))

    def price(rows: tuple[int, ...]) -> float:
        whole = errors.expected_mm[rows[0]] / unit
        for before, after in pairwise(rows):
            away = candidates.q[after] - candidates.q[before]
            error = errors.error_mm[after] + sum(
                errors.rising_mm[after, k] if away[k] > 0 else errors.falling_mm[after, k] for k in range(2)
            )
            whole += np.hypot(np.linalg.norm(error), errors.u_mm[after]) / unit + 0.1 * np.abs(away).max()
            whole += change * (candidates.branch[after] != candidates.branch[before])
        return float(whole)

    every = list(product(*(range(3 * k, 3 * k + 3) for k in range(4))))
    assert tuple(best_sequence(candidates, errors, change=change).rows) == min(every, key=price)


def test_a_singular_posture_of_the_program_is_compared_but_not_chosen():
    rig = ur10(JointOffset(axis=5, offset_deg=SIZE_DEG))
    given = np.stack([POSTURE, POSTURE])
    given[1, 4] = np.radians(0.1)
    found = choose_postures(rig, forward(arm_of(rig.robot), given), given)
    reached = dict(found.candidates.groups())
    assert found.candidates.conditioning[found.usual.rows].min() < LEAST_CONDITIONING or 1 not in reached
    assert found.candidates.conditioning[found.best.rows].min() > LEAST_CONDITIONING


def test_the_whole_part_is_in_reach_at_the_best_place():
    rig, part = ur10(JointOffset(axis=3, offset_deg=SIZE_DEG)), np.array([300.0, 200.0, 0.0])
    pose = forward(arm_of(rig.robot), POSTURE[None])[0]
    placed = work_map(rig, part, pose, POSTURE, about(POSTURE, 30))
    corners = np.tile(pose, (4, 1, 1))
    corners[:, :2, 3] = placed.best_mm + np.array([[-150, -100], [150, -100], [-150, 100], [150, 100]])
    assert not find_candidates(arm_of(rig.robot), corners, POSTURE).reasons
    assert placed.at(*placed.best_mm) == np.nanmin(placed.expected_mm)
    assert np.isnan(placed.at(*placed.x_mm[[0, 0]]))  # the corner of the map is out of reach
    assert work_map(rig, np.array([3000.0, 3000.0, 0.0]), pose, POSTURE, about(POSTURE, 30)).best_mm is None


def test_a_rail_is_one_more_free_axis():
    text = f"name: arm\n{load_arm('ur10').text}  rail: {{direction: [0, 1, 0], limits_mm: [0, 2000]}}\n"
    rig = parse(text, "x")
    arm = arm_of(rig.robot)
    pose = forward(arm, np.append(POSTURE, 0.5)[None])
    found = choose_postures(rig, pose)
    stands = np.unique(found.candidates.q[:, 6])
    assert len(stands) > 1
    assert np.abs(forward(arm, found.candidates.q) - pose).max() < 1e-6
