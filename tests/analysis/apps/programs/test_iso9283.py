"""The programs of ISO 9283 in five dialects, run by interpreters that do not know their writers, on an arm of its
own: they stop at the cube's poses and drive its paths as the standard draws them."""

from functools import lru_cache

import numpy as np
import pytest

from analysis.apps.makers.emulated import LinearMove, PointToPointMove, Round, Waited
from analysis.apps.programs.planned import cube_plan, path_plan
from analysis.robot.geometry.iso_cube import cube_of
from rigs.makers import MAKERS
from rigs.rig import Rig
from rigs.schema.declared_tests import Iso9283
from tests.support.changed_rigs import with_tests
from tests.support.every import for_every_maker
from tests.worlds.arms.iso_plain import cube_places
from tests.worlds.interpreters.arms import pose_of, rig_of
from tests.worlds.interpreters.driven import ROUNDING, files_of, run

ARMS = ("ur10e-cell", "paper-fanuc")
PLACE_MM = {"yaskawa": 5e-3}


@lru_cache
def with_cube(arm: str) -> Rig:
    return with_tests(rig_of(arm), iso9283=Iso9283(cycles=3, path_cycles=3))


def in_world(rig: Rig, places: np.ndarray) -> np.ndarray:
    base = pose_of(rig.robot.base)
    return base.turn.apply(places) + base.place


@for_every_maker
@pytest.mark.parametrize("arm", ARMS)
def test_the_cube_is_visited_in_the_order_of_the_standard(arm, dialect):
    rig = with_cube(arm)
    cube = cube_of(rig)
    expected = cube_places(cube.centre_mm, cube.side_mm)[[0, *([4, 3, 2, 1, 0] * 3)]]
    events = run(dialect, files_of(dialect, cube_plan(rig, 4.0)), rig)
    stood = [event.pose for event in events if isinstance(event, PointToPointMove)]
    places = in_world(rig, np.array([pose.place for pose in stood]))
    assert np.abs(places - expected).max() < max(PLACE_MM.get(dialect, 0.0), 1e-4)
    turned = [(stood[0].turn.inv() * pose.turn).magnitude() for pose in stood]
    assert max(turned) < 1e-4  # the tool keeps its orientation
    assert sum(event.seconds >= 4.0 for event in events if isinstance(event, Waited)) == 15


@pytest.mark.parametrize("dialect", [maker for maker in MAKERS if maker != "linuxcnc"])  # its rings are lines
@pytest.mark.parametrize("arm", ARMS)
def test_paths_follow_the_standard_between_two_stands(arm, dialect):
    rig = with_cube(arm)
    cube = cube_of(rig)
    _, p2, p3, p4, p5 = cube_places(cube.centre_mm, cube.side_mm)
    driven = [[]]
    for event in run(dialect, files_of(dialect, path_plan(rig, 50)), rig):
        if isinstance(event, Waited):
            driven.append([])
        elif isinstance(event, LinearMove | Round) and event.length_mm > max(ROUNDING, PLACE_MM.get(dialect, 0.0)):
            driven[-1].append(event)
    whole = [one for one in driven if one]
    assert all(not piece.stops for one in whole for piece in one[:-1]) and all(one[-1].stops for one in whole)
    lines = [one for one in whole if len(one) == 1 and isinstance(one[0], LinearMove)]
    lengths = np.array([one[0].length_mm for one in lines])
    assert (np.abs(lengths - np.linalg.norm(p4 - p2)) < 0.01).sum() == 3
    rectangles = [one for one in whole if len(one) == 4]
    corners = in_world(rig, np.array([piece.end.place for one in rectangles for piece in one]))
    assert np.abs(corners - np.tile([p3, p4, p5, p2], (3, 1))).max() < 0.01
    rings = [one for one in whole if all(isinstance(piece, Round) for piece in one)]
    around = np.array([sum(piece.length_mm for piece in one) for one in rings]) / (2 * np.pi)
    assert np.sort(np.round(around / cube.side_mm, 4)).tolist() == [0.04] * 3 + [0.4] * 6
    assert {round(piece.speed_mm_s, 2) for one in whole for piece in one} == {125.0}
