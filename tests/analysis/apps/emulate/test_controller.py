from typing import Any

import numpy as np
import pytest

from analysis.apps.emulate.driving import ControllerState
from rigs.schema.vocabulary import MakerName
from tests.support.maker_controllers import NO_DELTA, UniversalRobots
from tests.support.refusals import refused
from tests.worlds.interpreters.arms import rig_of

ARMS = {
    "ur": "ur10e",
    "fanuc": "paper-fanuc",
    "kuka": "kuka-kr-10-r1100-2",
    "abb": "abb-irb-120",
    "yaskawa": "yaskawa-gp7",
}


def of(maker: MakerName) -> ControllerState:
    return ControllerState.of_rig(rig_of(ARMS[maker]), maker)


def entry(parameter: str, add: Any, unit: str, now: float | None = None) -> dict[str, Any]:
    return {"parameter": parameter, "axis": 2, "add": add, "unit": unit, "now": now}


def entered(maker: MakerName, *entries: Any) -> ControllerState:
    return of(maker).entered({"controller": {"name": maker, "entries": list(entries)}}, "corrections.yaml")


def test_deltas_of_a_universal_robot_are_those_of_the_makers_product():
    """The classic Denavit-Hartenberg product of the maker, by its table of the UR10e."""
    a, d = np.array([0, -0.6127, -0.57155, 0, 0, 0]), np.array([0.1807, 0, 0, 0.17415, 0.11985, 0.11655])
    alpha = np.array([np.pi / 2, 0, 0, np.pi / 2, -np.pi / 2, 0])
    maker, q = UniversalRobots(a, alpha, d, NO_DELTA, NO_DELTA), np.array([0.1, -1.2, 1.4, 0.3, 0.9, 2])
    deltas = [("delta_theta", 4, 2e-3), ("delta_a", 2, 6e-4), ("delta_d", 5, -4e-4), ("delta_alpha", 3, 1e-3)]
    for name, index, value in deltas:
        before = maker.flange(q, maker.delta)[1]
        maker = maker.with_added(name, index, value)
        assert np.linalg.norm(maker.flange(q, maker.delta)[1] - before) > 0.05, name
    unit = {"delta_theta": "rad", "delta_alpha": "rad"}
    ours = entered("ur", *(entry(f"{name}[{at}]", value, unit.get(name, "m")) for name, at, value in deltas))
    R, p = maker.flange(q, maker.delta)
    np.testing.assert_allclose(ours.flange(q)[1], p, atol=1e-9)
    np.testing.assert_allclose(ours.flange(q)[0], R, atol=1e-12)


@pytest.mark.parametrize(
    ("maker", "parameter", "field", "axis"),
    [
        ("fanuc", "$PARAM_GROUP[1].$DH_A[2]", "a", 3),
        ("fanuc", "$PARAM_GROUP[1].$DH_D[4]", "d", 4),
        ("kuka", "$LENGTH_A", "a", 2),
        ("kuka", "length in $TX3P3", "d", 4),
        ("kuka", "length in $TFLWP", "d", 6),
    ],
)
def test_a_length_grows_whichever_its_sign(maker, parameter, field, axis):
    before = getattr(of(maker).arm, field)
    after = getattr(entered(maker, entry(parameter, 0.4, "mm", float(abs(before[axis - 1])))).arm, field)
    grown = np.abs(after) - np.abs(before)
    assert grown[axis - 1] == pytest.approx(0.4) and not np.delete(grown, axis - 1).any()


@pytest.mark.parametrize(
    ("corrections", "code"),
    [
        (None, "controller.invalid"),
        ({"controller": None}, "controller.invalid"),
        ({"controller": {"name": "kuka", "entries": "none"}}, "controller.invalid"),
        ({"controller": {"name": "ur", "entries": []}}, "robot.other"),
        ([entry("$MAMES[7]", 0.1, "deg")], "controller.invalid"),
        ([entry("$MAMES[1]", 0.1, "deg"), entry("$MAMES[1]", 0.1, "rad")], "controller.invalid"),
        ([entry("$MAMES[1]", float("nan"), "deg")], "controller.invalid"),
        ([entry("$MAMES[1]", True, "deg")], "controller.invalid"),
        ([entry("$MAMES[1]", "1", "deg")], "controller.invalid"),
        ([7], "controller.invalid"),
        ([entry("$LENGTH_A", 0.3, "mm", 123.0)], "controller.invalid"),
    ],
)
def test_invalid_entry_is_refused(corrections, code):
    given = {"controller": {"name": "kuka", "entries": corrections}} if isinstance(corrections, list) else corrections
    with refused(code):
        of("kuka").entered(given, "corrections.yaml")
