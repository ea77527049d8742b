"""Circles fitted to motions that an independent program has drawn, and motions that are refused."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

from analysis.apps.commission.driven_circle import DrivenCircle, driven_circle
from analysis.robot.geometry.circle import frame_of
from analysis.robot.geometry.driven_programs import circle_of, circle_program, stops
from analysis.robot.kinematics.arm import Arm, Array, arm_of
from analysis.robot.kinematics.follow import follow
from analysis.runs.loading import RobotMotion
from rigs.errors import FileError
from rigs.load import load, parse
from tests.support.archives import Archive
from tests.support.changed_rigs import with_circle, with_robot, with_tests
from tests.support.every import both_ways

HZ = 50.0
NOISE_RAD = np.radians(0.0005)


RIG = load("ur10e-cell")[0]
BLANK = with_tests(RIG, circle=None)
ARM, CIRCLE = arm_of(RIG.robot), circle_of(RIG)
FRAME = frame_of(CIRCLE)


def sampled(t_s: Array, q: Array, seed: int = 0) -> RobotMotion:
    at = np.arange(0.0, t_s[-1], 1 / HZ)
    angles = np.stack([np.interp(at, t_s, joint) for joint in q.T], axis=1)
    return RobotMotion("run", at, angles + np.random.default_rng(seed).normal(0, NOISE_RAD, angles.shape))


def program(direction: str = "acw", laps: int = 1) -> RobotMotion:
    driven = circle_program(with_circle(RIG, laps=laps), direction)
    return replace(sampled(driven.t_s, driven.q), direction=direction)


def followed(poses: Array, arm: Arm = ARM) -> Array:
    """Joint angles (n, 6) rad at poses, from the posture of the shipped circle on."""
    return follow(arm, poses, np.radians(CIRCLE.posture_deg), "test")


def around(degrees: Array, radius_mm: float = FRAME.radius, shift_mm: float = 0.0) -> Array:
    """Joint angles (n, 6) of the shipped circle at circle angles, or of one beside it."""
    frame = replace(FRAME, radius=radius_mm, centre=FRAME.centre + shift_mm * FRAME.u)
    return followed(frame.poses(np.radians(degrees)))


def driven_along(q: Array, seconds: float = 10.0) -> RobotMotion:
    return sampled(np.linspace(0, seconds, len(q)), q)


def joined(*motions: RobotMotion) -> RobotMotion:
    t_s, q = motions[0].t_s, motions[0].q
    for motion in motions[1:]:
        way = np.linspace(q[-1], motion.q[0], int(2 * HZ))
        t_s = np.concatenate([t_s, t_s[-1] + np.arange(1, len(way) + 1) / HZ])
        t_s = np.concatenate([t_s, t_s[-1] + 1 / HZ + motion.t_s])
        q = np.concatenate([q, way, motion.q])
    return RobotMotion("run", t_s, q)


def centre_off_mm(found: DrivenCircle) -> float:
    return float(np.linalg.norm(found.circle.centre - FRAME.centre))


def off(found: DrivenCircle) -> float:
    """The largest deviation from the shipped circle: of the centre or radius in mm, or of the normal in degrees."""
    angle = np.degrees(np.arcsin(min(1.0, np.linalg.norm(np.cross(found.circle.n, FRAME.n)))))
    return max(centre_off_mm(found), float(angle), abs(found.circle.radius - FRAME.radius))


@both_ways
@pytest.mark.parametrize("laps", [1, 2])
def test_program_shows_the_circle_of_its_rig_file(direction, laps):
    found = driven_circle([program(direction, laps)], BLANK)
    assert off(found) < 0.02
    assert found.circle.n @ FRAME.n > 0.99 and found.circle.u @ FRAME.u > np.cos(np.radians(2))
    np.testing.assert_allclose(found.posture, around(np.zeros(1))[0], atol=np.radians(3))
    assert 0 < found.u_centre_mm.max() < 0.02 and found.doubts == ()


def test_start_of_the_rig_file_keeps_its_zero_direction():
    found = driven_circle([program()], RIG)
    assert found.keeps_zero and "zero" not in found.values()
    assert "zero" in driven_circle([program()], BLANK).values()


def test_approach_stop_and_outliers_are_not_used():
    lap = program()
    home = lap.q[0] + np.radians([20, -15, 10, 5, -5, 30])
    approach = driven_along(np.linspace(home, lap.q[0], 60), 3.0)
    stop = np.repeat(lap.q[600:601], 120, axis=0)
    stopped = driven_along(np.concatenate([lap.q[:600], stop, lap.q[600:]]), lap.t_s[-1] + 120 / HZ)
    whole = joined(approach, stopped, driven_along(np.linspace(lap.q[-1], home, 60), 3.0))
    q = whole.q.copy()
    q[900] += np.radians(3.0)
    q[1300, 2] -= np.radians(0.4)
    found = driven_circle([replace(whole, q=q)], BLANK)
    assert off(found) < 0.03
    assert len(found.doubts) == 1


@pytest.mark.parametrize("count", [3, 5, 8])
def test_stops_show_the_circle(count):
    q = around(np.arange(count) * 360 / count)
    found = driven_circle([sampled(*stops(q, dwell_s=1.5))], BLANK)
    assert off(found) < 0.05
    assert f"{count} stops" in found.used
    assert any("add a point" in doubt for doubt in found.doubts) == (count == 3)


def test_circle_guided_by_hand_has_its_own_uncertainty():
    rng = np.random.default_rng(3)
    degrees = np.linspace(0, 350, 40)
    wobble = 1.2 * np.cumsum(rng.normal(size=(40, 3)), axis=0) / np.sqrt(40)
    poses = FRAME.poses(np.radians(degrees))
    poses[:, :3, 3] += wobble - wobble.mean(axis=0)
    found = driven_circle([sampled(np.linspace(0, 30, 40), followed(poses))], BLANK)
    assert centre_off_mm(found) < 4 * found.u_centre_mm.max() and 0.02 < found.u_centre_mm.max() < 2.5


def bent(scale_deg: float) -> RobotMotion:
    """A lap whose controller has zeros that the rig file does not know."""
    own = replace(ARM, offset=ARM.offset + np.radians(scale_deg) * np.array([1.0, -1.0, 1.0, 1.0, -1.0, 1.0]))
    poses = FRAME.poses(np.radians(np.linspace(-10, 370, 900)))
    return sampled(np.linspace(0, 18, 900), followed(poses, own))


def test_complete_lap_of_a_controller_with_other_constants_is_found():
    slightly, badly = (driven_circle([bent(scale)], BLANK) for scale in (0.02, 0.5))
    assert np.degrees([slightly.arc, badly.arc]) == pytest.approx(380, abs=5)
    assert slightly.doubts == () and badly.doubts
    assert badly.u_radius_mm > 10 * slightly.u_radius_mm


def test_wrong_direction_label_is_reported_and_the_normal_follows_the_tool():
    found = driven_circle([replace(program("acw"), direction="cw")], BLANK)
    assert found.circle.n @ FRAME.n > 0.99
    assert any("--direction acw" in doubt for doubt in found.doubts)


def test_other_tool_orientation_is_reported():
    tool = RIG.robot.tool.model_copy(update={"rpy_deg": (0.0, 90.0, 40.0)})
    assert any("40°" in doubt for doubt in driven_circle([program()], with_robot(BLANK, tool=tool)).doubts)


def refused(*motions: RobotMotion) -> str:
    with pytest.raises(FileError) as raised:
        driven_circle(motions, BLANK)
    return raised.value.code


def _rows(*t_s: float) -> RobotMotion:
    return RobotMotion("run", np.array(t_s), around(np.arange(len(t_s)) * 90.0))


def _on_line() -> RobotMotion:
    poses = np.repeat(FRAME.poses(np.zeros(1)), 4, axis=0)
    poses[:, :3, 3] += np.linspace(0, 90, 4)[:, None] * np.array([0.0, 1.0, 0.0])
    return sampled(*stops(followed(poses), dwell_s=2.0))


def _short(arc_deg: float) -> RobotMotion:
    noisy = driven_along(around(np.linspace(0, arc_deg, 60)))
    return replace(noisy, q=noisy.q + np.random.default_rng(1).normal(0, np.radians(0.004), noisy.q.shape))


def _lap(**other: float) -> RobotMotion:
    return driven_along(around(np.linspace(0, 350, 300), **other))


def _jumping() -> RobotMotion:
    lap = program()
    q = lap.q.copy()
    q[len(q) // 2 :, 0] += np.radians(3.0)
    return replace(lap, q=q)


def _wandering() -> RobotMotion:
    q = np.cumsum(np.random.default_rng(2).normal(0, 0.02, (12, 6)), axis=0)
    return sampled(np.linspace(0, 12, 12), np.radians(CIRCLE.posture_deg) + q)


@pytest.mark.parametrize(
    ("motions", "codes"),
    [
        (lambda: [driven_along(np.repeat(around(np.zeros(1)), 50, axis=0))], ["readings.unsuitable"]),
        (lambda: [_rows(0.0, 0.01, 0.02)], ["readings.too_few"]),
        (lambda: [_rows(0.0, 0.01, 0.02, 5.0)], ["readings.too_few"]),
        (lambda: [sampled(*stops(around(np.array([0.0, 60.0])), dwell_s=2.0))], ["readings.unsuitable"]),
        (lambda: [_on_line()], ["readings.unsuitable"]),
        (lambda: [_short(5)], ["readings.unsuitable", "readings.unsuitable"]),
        (lambda: [_short(12)], ["readings.unsuitable", "readings.unsuitable"]),
        (lambda: [joined(_lap(), _lap(radius_mm=55.0, shift_mm=30.0))], ["readings.unsuitable"]),
        (lambda: [_lap(), replace(_lap(shift_mm=25.0), where="other")], ["readings.unsuitable"]),
        (lambda: [_jumping()], ["readings.unsuitable"]),
        (
            lambda: [sampled(*stops(np.concatenate([around(np.arange(3) * 120.0), at_home()]), dwell_s=1.5))],
            ["readings.unsuitable"],
        ),
        (lambda: [_wandering()], ["readings.unsuitable", "readings.unsuitable"]),
    ],
    ids=[
        "stood still", "few rows", "a gap", "two points", "line", "arc of 5°", "arc of 12°",
        "two circles", "two runs", "jump", "one elsewhere", "no circle",
    ],
)  # fmt: skip
def test_motion_without_a_single_circle_is_refused(motions, codes):
    assert refused(*motions()) in codes


def at_home() -> Array:
    """Angles (1, 6) of a stand that is not on the circle."""
    return around(np.zeros(1)) + np.radians([8.0, -5, 0, 0, 10, 0])


@pytest.mark.parametrize("count", [4, 6])
def test_home_position_before_and_after_is_not_used(count):
    q = around(np.arange(count) * 360 / count)
    found = driven_circle([sampled(*stops(np.concatenate([at_home(), q, at_home()]), dwell_s=1.5))], BLANK)
    assert off(found) < 0.05 and f"{count} stops" in found.used
    assert any("2 stops" in doubt for doubt in found.doubts)


@pytest.mark.parametrize("kind", ["arc", "lap"])
def test_errors_of_independent_motions_agree_with_the_uncertainty(kind):
    """Motions of arms of other lengths with noise that the model of rig lacks, drawn by a program without rig."""
    archive, found = Archive("motions"), []
    for about in archive.about:
        columns = archive.columns(about["measured"])
        if about["kind"] == kind:
            run = RobotMotion("drawn", columns["t_s"], columns["q"], about["direction"])
            fit = driven_circle([run], parse(yaml.safe_dump(about["rig"]), "drawn"))
            across = np.linalg.svd([about["normal"]])[2][1:]
            sd = np.sqrt(np.einsum("ki,ij,kj->k", across, fit.normal_cov, across))
            off_u = (fit.circle.centre - about["centre"]) / fit.u_centre_mm
            radius = (fit.circle.radius - about["radius"]) / fit.u_radius_mm
            found.append([*off_u, *across @ fit.circle.n / sd, radius])
    errors = np.array(found)
    # docs/evidence/uncertainty.md has the coverage of hundreds; here what a wrong u would break at once.
    assert (np.abs(errors) < 1.96).mean() > 0.8 and np.sqrt((errors**2).mean()) < 1.6
    assert np.sqrt((errors**2).mean()) > 0.3
