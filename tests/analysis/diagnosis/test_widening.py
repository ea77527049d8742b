from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest

from analysis.diagnosis.evidence.blocks import _visit_numbers  # private: which poses repeat is said nowhere else
from analysis.diagnosis.evidence.observation import observe
from analysis.diagnosis.evidence.placements import reach_mm
from analysis.diagnosis.judge.held_out import _Neighbourhoods  # private: the sums that the factor is made of
from analysis.diagnosis.judge.judge import temperature_of
from analysis.procedures.shared.test_kind import kind_of
from analysis.robot.kinematics.arm import transform
from analysis.robot.predict import SetUp, model_of
from analysis.runs.tables import PoseTable
from rigs.arms import load_arm
from rigs.load import parse
from rigs.schema.robot import Pose

RNG = np.random.default_rng(5)
STATED = RNG.uniform(0.02, 0.3, 60) ** 2
NOISE = np.full(60, 0.03**2)


def missed(variance: np.ndarray) -> _Neighbourhoods:
    """Neighbourhoods of ten poses that share their error, of a given variance beside the noise."""
    squares = (variance + NOISE) * RNG.chisquare(3, 60) / 3
    return _Neighbourhoods(squares, NOISE, STATED, np.full(60, 30.0))


def test_misses_proportional_to_the_stated_u_are_a_factor():
    wider = missed(4 * STATED).parted()
    assert 1.6 < wider.factor < 2.7
    assert wider.unexplained_mm < 0.12
    assert wider.beyond_mm == pytest.approx(np.sqrt(3 * STATED.mean()), rel=0.3)


def test_misses_that_are_the_same_everywhere_are_unexplained():
    wider = missed(STATED + 0.3**2).parted()
    assert wider.factor < 1.8  # a wide share of the places states nearly as much
    assert wider.unexplained_mm == pytest.approx(0.3, rel=0.35)
    assert wider.beyond_mm == pytest.approx(0.3, rel=0.2)


def test_a_model_that_states_enough_is_not_narrowed():
    wider = missed(0.3 * STATED).parted()
    assert wider.factor == 1.0 and wider.unexplained_mm == wider.beyond_mm == 0.0


def test_one_place_far_off_does_not_decide():
    sound = missed(STATED)
    squares = sound.square_mm2.copy()
    squares[7] = 400 * STATED[7]
    ratio, _ = _Neighbourhoods(squares, NOISE, STATED, sound.weight).ratio_and_weight
    assert ratio < 2 * max(sound.ratio_and_weight[0], 1.0)


def test_reach_of_a_validation_is_that_of_the_farthest_placement():
    def at(x_mm: float) -> SetUp:
        return SetUp(np.zeros(3), np.zeros(1), transform(Pose(xyz_mm=(x_mm, 0, 0))), np.eye(4))

    places = {"a, socket 0": 0.0, "a, socket 1": 50.0, "b, socket 0": 300.0, "c, socket 0": 500.0}
    used = {f"touch at {name}": at(x_mm) for name, x_mm in places.items()}
    assert reach_mm(used, used) == 300.0
    assert reach_mm({**used, "touch at d, socket 0": at(900.0)}, used) == 400.0
    assert reach_mm(one := dict(list(used.items())[:2]), one) == 50.0
    assert reach_mm(alone := dict(list(used.items())[:1]), alone) == 0.0


def test_a_pose_that_is_reached_from_two_sides_is_no_repeat():
    model = model_of(parse(f"name: x\n{load_arm('ur10e').text}", "x"))
    q = np.tile(np.linspace(-1, 1, 6), (4, 1)) + np.repeat([[0.0], [0.3]], 2, axis=0)
    came_from = q - np.array([[0.1], [-0.1], [0.1], [0.1]])
    table = PoseTable(q, np.zeros((4, 3)), None, came_from=came_from)
    np.testing.assert_array_equal(table.sides, np.sign(q - came_from))
    numbers = [_visit_numbers(observe(model, one, "x"))[::3] for one in (table, PoseTable(q, table.xyz_mm, None))]
    assert [len(set(visits.tolist())) for visits in numbers] == [3, 2]
    np.testing.assert_array_equal(kind_of(table.test).path(model, table).q[::3], came_from)


@pytest.mark.parametrize(
    ("name", "cells", "expected"),
    [
        ("temp_J2 [C]", ["20,5", "21"], [20.5, 21.0]),
        ("Temperature", ["20.5", "21"], [20.5, 21.0]),
        ("attempt", ["1", "2"], None),
        ("template", ["1", "2"], None),
        ("temp", ["warm", "21"], None),
    ],
)
def test_a_temperature_column_is_known_by_its_word(name, cells, expected):
    table = SimpleNamespace(q=np.zeros((2, 6)))
    used = [SimpleNamespace(run=SimpleNamespace(table=pa.table({name: cells})), table=table)]
    values = temperature_of(used)
    assert (values is None) if expected is None else values.tolist() == expected
