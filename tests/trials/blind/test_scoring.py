from typing import Any

import pytest

from tests.support.rates import wilson
from tests.trials.blind.scoring import RealCase, real_cases_of

BACKLASH = {
    "name": "backlash 1",
    "effect": "backlash",
    "axis": 1,
    "parameters": {"width_deg": 0.5},
    "size": "width_deg",
    "class": ["backlash 1", "servo_lag 1"],
    "testable": True,
}
A5 = BACKLASH | {"name": "link_geometry 5.a", "class": ["joint_offset 5", "link_geometry 5.a"]}


def named(name: str, **more: Any) -> dict[str, Any]:
    return {"name": name, "parameters": {}} | more


PLAY = named("backlash 1", parameters={"width_deg": {"value": 0.505, "sd": 0.01}}, posterior=0.995)
ZERO, LAG = named("joint_offset 5"), named("time_lag", posterior=0.97)


def case(kind: str, answer: Any, *hidden: dict[str, Any], **more: Any) -> RealCase:
    truth = {"case": "a", "kind": kind, "seed": 1, "hidden": list(hidden), "outside": [], "background": []} | more
    return real_cases_of([truth], {"a": answer})[0]


def said(condition: str, *effects: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"condition": condition, "effects": list(effects), "seconds": 1.5} | more


def large_share(lag_s: float) -> dict[str, Any]:
    return {"name": "time_lag", "effect": "time_lag", "parameters": {"lag_s": lag_s}, "healthy": 0.001}


def test_wilson_interval():
    """81 of 263 is the example of Newcombe (1998): 0.2553 to 0.3662."""
    assert wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=1e-4)
    assert wilson(0, 300) == pytest.approx((0, 0.01264), abs=1e-4)
    assert wilson(0, 0) == (0.0, 1.0)


@pytest.mark.parametrize(
    ("answer", "hidden", "first", "every", "wrong"),
    [
        (said("named", PLAY, LAG), [BACKLASH], True, True, 1),
        (said("named", LAG, PLAY), [BACKLASH], False, True, 1),
        (said("named", named("servo_lag 1")), [BACKLASH], True, True, 0),
        (said("named", named("ball_form", rivals=[PLAY])), [BACKLASH], False, False, 1),
        (said("named", PLAY, ZERO), [BACKLASH, A5], True, True, 0),
        (said("named", PLAY), [BACKLASH, A5], True, False, 0),
        (said("outside_library", PLAY), [BACKLASH], True, True, 0),
        (said("nothing_unusual", LAG | {"stands": False}), [], False, True, 0),
        (None, [BACKLASH], False, False, 0),
        ({"error": "singular"}, [BACKLASH], False, False, 0),
    ],
)
def test_names_are_right_by_fault_or_twin(answer, hidden, first, every, wrong):
    one = case("one", answer, *hidden)
    assert (one.first, one.all_named, len(one.wrong)) == (first, every, wrong)


@pytest.mark.parametrize(("lag_s", "wrong"), [(0.006, 0), (0.004, 1)])
def test_a_name_is_not_wrong_from_five_healthy_sizes_on(lag_s, wrong):
    assert len(case("healthy", said("named", LAG), background=[large_share(lag_s)]).wrong) == wrong
