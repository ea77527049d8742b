from dataclasses import replace

import numpy as np
import pytest

from analysis.apps.commission.touched_ball import REST_S, RestDetector, Touching
from analysis.procedures.simulate import planned_touches
from analysis.robot.geometry.pose_setup import moved_by
from analysis.robot.kinematics.arm import Array, arm_of
from rigs.arms import load_arm
from rigs.load import parse
from rigs.rig import Rig

EVERY_S = 0.1


@pytest.fixture(scope="module")
def rig():
    text = load_arm("franka-fr3").text
    return parse(f"name: seven\n{text}tests: {{touch: {{sockets: [A, B], touches: 12}}}}\n", "seven.yaml")


def touching(rig: Rig, touches: int = 12) -> Touching:
    arm = arm_of(rig.robot)
    ball = moved_by(np.eye(4), np.array([0.0, 0.0, 100.0]), np.zeros(3))
    return Touching(replace(arm, T_flange_tool=arm.T_flange_tool @ ball), ("A", "B"), touches)


def guided(postures: Array, came_from: Array) -> Array:
    """Return angles (n, axes) in degrees of an arm that rests at each posture, with backlash by the direction of
    arrival.
    """
    rows = []
    at = came_from[0] + 0.1
    for here, before in zip(np.degrees(postures), np.degrees(came_from), strict=True):
        for start, end in ((at, before), (before, here)):
            rows += list(start + np.linspace(0, 1, 20)[:, None] * (end - start))
        rows += [here] * round((REST_S + 1.0) / EVERY_S)
        at = here
    return np.array(rows)


def fed(guide: Touching, rows: Array) -> list[str]:
    detector = RestDetector()
    return [guide.take(row, detector.came_deg) for k, row in enumerate(rows) if detector.feed(EVERY_S * k, row)]


def test_rest_elsewhere_is_reported_once_and_not_taken(rig):
    planned = planned_touches(rig)
    guide, q, came = touching(rig), planned.q[:2].copy(), planned.came_from[:2]
    q[1] = planned.q[8]  # socket B, while A is asked for
    assert fed(guide, guided(q, came)) == ["seated", "elsewhere"]
    assert guide.count == 1


@pytest.mark.parametrize("stop", [0, 6])
def test_stop_elsewhere_before_the_first_touch_of_a_socket_is_dropped(rig, stop):
    """A robot that stood elsewhere at the start was taken as the first touch, and all real touches were rejected."""
    planned = planned_touches(rig)
    away = planned.q[8 - stop] + np.radians([20.0, -20, 20, 0, 0, 0, 0])
    q, came = (np.insert(rows, stop, away + k * 0.1, axis=0) for k, rows in enumerate((planned.q, planned.came_from)))
    guide = touching(rig)
    seen = fed(guide, guided(q, came))
    assert seen.count("elsewhere") == 1 and seen.count("seated") == 12
    np.testing.assert_allclose(guide.table.q, planned.q, atol=1e-9)
    assert guide.table.socket.tolist() == planned.socket.tolist()


def test_repeated_posture_is_not_taken(rig):
    planned = planned_touches(rig)
    q = planned.q[[0, 0]]
    guide = touching(rig)
    assert fed(guide, guided(q, q + np.radians(2.0))) == ["seated", "same posture"]
