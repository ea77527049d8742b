"""Five dialects, four tests, three arms: each program is run, and its path is the simulator's.

The interpreters know neither the writers nor the plan, the arms are computed by other code, and the path to compare
with is that of the joint angles which the simulator drives.
"""

from functools import lru_cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.apps.makers.emulated import (
    Array,
    ConfigurationFlags,
    LinearMove,
    OperatorPause,
    PointToPointMove,
    Round,
    Waited,
)
from analysis.apps.makers.motion_plan import Demand, MotionPlan, demand_of
from analysis.apps.programs.planned import plans_of
from analysis.robot.geometry.circle import frame_of
from analysis.robot.geometry.driven_programs import (
    circle_of,
    circle_program,
    hemisphere_of,
    radial_stops,
    repeatability_stops,
)
from rigs.schema.vocabulary import DrivenTest, MakerName
from tests.support.every import both_ways, for_every_maker
from tests.worlds.interpreters.arms import ARMS, LIBRARY, pose_of, reached, rig_of
from tests.worlds.interpreters.driven import ROUNDING, along, files_of, paths, run, stops
from tests.worlds.interpreters.joints import postures

DWELL_S = 4.0
PLACE_MM = {"yaskawa": 5e-3, "linuxcnc": 5e-3}
"""A job holds 0.001 mm: its points are wrong by up to 0.9 µm, and what its arcs are longer or shorter adds up. Lines of
G-code deviate from a curve by up to 1 µm, and the chords are shorter than their arcs."""
TURN_RAD = {"yaskawa": 1e-4, "linuxcnc": 1e-4}
"""A job holds 0.0001°; places wrong by 5 µm along a circle of 70 mm are 7e-5 rad."""
EXACT_MM, EXACT_RAD = 1e-6, 1e-7


@lru_cache
def programs(arm: str, test: DrivenTest, dialect: MakerName) -> tuple[dict[str, str], ...]:
    return tuple(files_of(dialect, *planned) for planned in planned_for(arm, test))


@lru_cache
def planned_for(arm: str, test: DrivenTest) -> tuple[tuple[MotionPlan, Demand], ...]:
    return tuple((plan, demand_of(plan)) for plan in plans_of(rig_of(arm), test, DWELL_S))


@lru_cache
def simulated(arm: str, direction: str) -> tuple[Array, Array, Rotation]:
    """Distance driven (n,) mm, places (n, 3) mm and orientations of the simulator's circle, in the base frame."""
    rig = rig_of(arm)
    program = circle_program(rig, "acw" if direction == "acw" else "cw")
    rows = np.unique(np.concatenate([np.arange(0, len(program.q), 25), [len(program.q) - 1]]))
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(program.phi)))]) * frame_of(circle_of(rig)).radius
    return way[rows], *reached(rig, program.q[rows])


def require_equal(dialect: str, one: tuple[Array, Rotation], places: Array, turns: Rotation) -> None:
    """Places and orientations are the same within what a language writes."""
    mm, rad = np.linalg.norm(one[0] - places, axis=1).max(), (one[1].inv() * turns).magnitude().max()
    assert mm < PLACE_MM.get(dialect, EXACT_MM) and rad < TURN_RAD.get(dialect, EXACT_RAD), (mm, rad)


@for_every_maker
@both_ways
@pytest.mark.parametrize("test", ["yaw", "roll"])
@pytest.mark.parametrize("arm", ARMS)
def test_a_circle_is_the_simulators(arm, test, direction, dialect):
    files = programs(arm, test, dialect)[("acw", "cw").index(direction)]
    pieces = paths(run(dialect, files, rig_of(arm)))
    way, *expected = simulated(arm, direction)
    require_equal(dialect, along(pieces, way), *expected)
    assert sum(piece.length_mm for piece in pieces) == pytest.approx(way[-1], abs=0.1)


@pytest.mark.parametrize(("arm", "dialect"), [(arm, arm.partition("-")[0]) for arm in LIBRARY])
def test_arms_of_the_library_drive_the_simulators_circle(arm, dialect):
    """In the language of their maker: their angles are the controller's, with its signs and couplings."""
    pieces = paths(run(dialect, programs(arm, "yaw", dialect)[0], rig_of(arm)))
    way, *expected = simulated(arm, "acw")
    require_equal(dialect, along(pieces, way), *expected)


@pytest.mark.parametrize(
    ("arm", "dialect", "axes"),
    [("fanuc-m-10ia", "fanuc", (3, 4, 5)), ("yaskawa-gp7", "yaskawa", (3, 5, 0)), ("kuka-hanging", "fanuc", (3, 4, 5))],
)
def test_positions_contain_the_posture_of_arrival(arm, dialect, axes):
    rig = rig_of(arm)
    start = circle_program(rig, "acw").q[0]
    said = postures(rig, run(dialect, programs(arm, "yaw", dialect)[0], rig), start)
    assert len({posture for _, posture in said}) > 1  # no count changes along this circle
    for q, posture in said:
        turns = np.sign(q[[*axes]]) * np.floor(np.abs(np.degrees(q[[*axes]])) / 360 + 0.5)
        expected = np.abs(turns) > 0 if dialect == "yaskawa" else turns
        assert posture == ConfigurationFlags(bool(q[4] > 0), tuple(map(int, expected))), np.degrees(q)


@for_every_maker
@pytest.mark.parametrize("test", ["radial", "repeatability"])
@pytest.mark.parametrize("arm", ARMS)
def test_stops_are_the_simulators(arm, test, dialect):
    rig = rig_of(arm)
    events = run(dialect, programs(arm, test, dialect)[0], rig)
    q = radial_stops(rig) if test == "radial" else repeatability_stops(rig)
    require_equal(dialect, stops(events), *reached(rig, q))


@for_every_maker
@pytest.mark.parametrize("arm", ARMS)
def test_the_link_is_never_pulled_between_targets(arm, dialect):
    """The way between targets keeps to the sphere, which the simulator's joint moves do not."""
    rig = rig_of(arm)
    sphere = hemisphere_of(rig)
    centre = pose_of(rig.robot.base).turn.inv().apply(np.array(sphere.centre_mm) - rig.robot.base.xyz_mm)
    pieces = paths(run(dialect, programs(arm, "radial", dialect)[0], rig))
    places = np.concatenate([piece.at(np.linspace(0, 1, 11))[0] for piece in pieces])
    # Between stops the lines of G-code deviate by up to 20 µm.
    assert np.abs(np.linalg.norm(places - centre, axis=1) - sphere.radius_mm).max() < max(
        PLACE_MM.get(dialect, EXACT_MM), 2e-2 * (dialect == "linuxcnc")
    )


@for_every_maker
def test_laps_run_at_the_speed_of_the_rig_file_and_stop_at_their_ends_only(dialect):
    circle = circle_of(rig_of("ur10e"))
    pieces = paths(run(dialect, programs("ur10e", "yaw", dialect)[0], rig_of("ur10e")))
    ends = [number for number, piece in enumerate(pieces) if piece.stops]
    laps = 2 * circle.laps - 1
    assert len(ends) == laps and ends[-1] == len(pieces) - 1
    count = len(pieces) // laps
    speeds = [{round(piece.speed_mm_s, 3) for piece in pieces[k * count : (k + 1) * count]} for k in range(laps)]
    assert speeds[0] == {circle.speed_mm_s} and speeds[1] == {2 * circle.speed_mm_s}
    if dialect != "linuxcnc":  # a tilted circle is a chain of lines
        assert all(isinstance(piece, Round) and np.degrees(piece.angle) <= 90.001 for piece in pieces)


@for_every_maker
def test_the_robot_waits_for_the_link_and_stands_at_each_target(dialect):
    events = run(dialect, programs("ur10e", "radial", dialect)[0], rig_of("ur10e"))
    first, line, hold = events[:3]
    assert isinstance(first, PointToPointMove) and isinstance(line, LinearMove) and isinstance(hold, OperatorPause)
    assert line.length_mm < ROUNDING  # the joint move has brought the arm there
    assert sum(isinstance(event, OperatorPause) for event in events) == 1
    targets = len(radial_stops(rig_of("ur10e")))
    assert sum(isinstance(event, Waited) and event.seconds == DWELL_S for event in events) == targets


@pytest.mark.parametrize("arm", ARMS)
def test_a_controller_that_interpolates_each_angle_turns_the_tool_the_same_way(arm):
    """The circle's axis is the tool's x axis, so that its turn is one of the three angles alone."""
    pieces = paths(run("fanuc", programs(arm, "yaw", "fanuc")[0], rig_of(arm)))
    share = np.linspace(0, 1, 31)
    for piece in pieces:
        assert isinstance(piece, Round) and piece.turning == "even"
        first, last = (pose.turn.as_euler("xyz") for pose in (piece.begin, piece.end))
        way = (last - first + np.pi) % (2 * np.pi) - np.pi
        by_angles = Rotation.from_euler("xyz", first + share[:, None] * way)
        assert (piece.at(share)[1].inv() * by_angles).magnitude().max() < EXACT_RAD
