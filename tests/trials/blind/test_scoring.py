"""The scorer of the real world on answers made by hand: every figure can be reached and can be missed."""

from __future__ import annotations

from typing import Any

import pytest

from tests.trials.blind.scoring import RealCase, as_json, real_cases_of, real_report, reliability, rows_of

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
FOREIGN = {"name": "dent", "effect": "dent", "rms_um": 100.0, "testable": True}
LARGE_SHARE = {"name": "time_lag", "effect": "time_lag", "parameters": {"lag_s": 0.006}, "healthy": 0.001}
PLAY = {"effect": "backlash", "axis": 1, "parameters": {"width_deg": {"value": 0.505, "sd": 0.01}}, "posterior": 0.995}
LAG = {"effect": "time_lag", "posterior": 0.97, "worth_um": 60.0}


def case(kind: str, answer: Any, *hidden: dict[str, Any], **more: Any) -> RealCase:
    truth = {"case": "a", "kind": kind, "seed": 1, "hidden": list(hidden), "outside": [], "background": []} | more
    return real_cases_of([truth], {"a": answer})[0]


def said(condition: str, *effects: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"condition": condition, "effects": list(effects), "seconds": 1.5} | more


def row(cases: list[RealCase], figure: str, after: str = "") -> tuple[str, bool | None]:
    """Value of a figure, of the first of that name below another."""
    rows = rows_of(cases)
    begin = next((k for k, other in enumerate(rows) if other.figure == after), 0)
    found = next(other for other in rows[begin:] if other.figure.strip() == figure)
    return found.value, found.reached


def test_a_right_first_name_counts_and_a_wrong_one_before_it_does_not() -> None:
    right, late = case("one", said("named", PLAY, LAG), BACKLASH), case("one", said("named", LAG, PLAY), BACKLASH)
    assert row([right], "one fault, testable: first and right")[1] is True
    assert row([late], "one fault, testable: first and right")[1] is False
    assert row([late], "in the list", "one fault, testable: first and right")[1] is True
    assert row([right], "names whose true size is healthy")[0].startswith("50.0 %")


def test_twins_count_and_faults_that_cannot_be_seen_do_not() -> None:
    twin = {"effect": "servo_lag", "axis": 1}
    assert case("one", said("named", twin), BACKLASH).first
    unseen = case("one", said("nothing_unusual"), BACKLASH | {"testable": False})
    assert row([unseen], "one fault, testable: first and right") == ("no cases", None)


def test_a_name_that_the_answer_does_not_stand_by_is_not_scored() -> None:
    healthy = case("healthy", said("nothing_unusual", LAG | {"stands": False}))
    assert row([healthy], "healthy arm: a name that is not there")[1] is True
    assert row([case("healthy", said("named", LAG))], "healthy arm: a name that is not there")[1] is False


def test_a_name_that_the_arm_has_at_five_times_its_healthy_size_is_not_wrong() -> None:
    assert not case("healthy", said("named", LAG), background=[LARGE_SHARE]).wrong
    small = LARGE_SHARE | {"parameters": {"lag_s": 0.004}}
    assert case("healthy", said("named", LAG), background=[small]).wrong


def test_all_names_of_several_faults() -> None:
    both = case("two", said("named", PLAY, {"effect": "joint_offset", "axis": 5}), BACKLASH, A5)
    assert row([both], "two faults, testable: all named")[1] is True
    assert row([case("two", said("named", PLAY), BACKLASH, A5)], "two faults, testable: all named")[1] is False


def test_names_listed_outside_the_library_count_too() -> None:
    assert case("one", said("outside_library", PLAY), BACKLASH).first


def test_foreign_signals() -> None:
    large = case("foreign_large", said("outside_library"), outside=[FOREIGN])
    assert row([large], "foreign and larger than all else: called outside")[1] is True
    fooled = case("foreign_large", said("named", LAG), outside=[FOREIGN])
    assert row([fooled], "foreign and larger than all else: called outside")[1] is False
    # 60 of 100 µm are 36 % of the energy; 40 are 16 %.
    assert fooled.gives_foreign_away
    assert not case("foreign_large", said("named", LAG | {"worth_um": 40.0}), outside=[FOREIGN]).gives_foreign_away
    # A wrong name whose worth is not told is taken at its worst.
    assert case("foreign_large", said("named", {"effect": "time_lag"}), outside=[FOREIGN]).gives_foreign_away
    told = case("foreign_third", said("named", PLAY, remainder={"um": 70.0}), BACKLASH, outside=[FOREIGN])
    assert told.tells_foreign and told.all_named
    assert not case("foreign_third", said("named", PLAY), BACKLASH, outside=[FOREIGN]).tells_foreign


def test_worth_follows_from_the_gap_where_an_answer_has_no_key_for_it() -> None:
    answer = said("named", {"effect": "time_lag", "gap_without_um": 50.0}, gap={"train": {"after": 30.0}})
    assert case("healthy", answer).standing[0].worth_um == pytest.approx(40.0)


def test_odds_are_held_against_how_often_they_are_right() -> None:
    honest = [case("one", said("named", PLAY), BACKLASH)] * 99
    told = [*honest, case("healthy", said("named", LAG | {"posterior": 0.995}))]
    assert row(told, "odds stated 99 to 100 %: right")[1]
    sure = [case("healthy", said("named", LAG | {"posterior": 0.9}))] * 10
    assert row(sure, "odds stated 80 to 95 %: right")[1] is False
    assert [(one.names, one.right) for one in reliability(sure)] == [(0, 0), (0, 0), (10, 0), (0, 0)]
    assert as_json(sure)["reliability"][2]["told"] == pytest.approx(0.9)
    assert row(sure, "odds stated 50 to 80 %: right") == ("no names", None)


def test_sizes_are_held_against_the_truth() -> None:
    far = PLAY | {"parameters": {"width_deg": {"value": 0.6, "sd": 0.01}}}
    cases = [case("one", said("named", PLAY), BACKLASH)] * 19 + [case("one", said("named", far), BACKLASH)]
    assert row(cases, "size: truth within 2 u")[1] is True
    assert row(cases[-1:], "size: truth within 2 u")[1] is False


def test_the_gap_is_that_of_every_case_named_or_not() -> None:
    cases = [
        case("one", said("named", left_by_truth={"unseen_place": left}), BACKLASH) for left in [0.0004] * 9 + [1.0]
    ]
    figure = "gap of the faults removed at an unseen place (energy): median"
    assert row(cases, figure)[1] is True
    assert row(cases[5:], "p10", figure)[1] is False


def test_rates_agree_where_verdict_and_names_do() -> None:
    same = [case(f"rate_{rate}", said("named", PLAY), BACKLASH) for rate in (50, 500)]
    figure = "50, 500, 4000 Hz: same condition and names"
    assert row(same, figure)[1] is True
    assert row([same[0], case("rate_500", said("named", PLAY, LAG), BACKLASH)], figure)[1] is False
    assert row(same[:1], figure) == ("no cases", None)


@pytest.mark.parametrize(
    "broken", [None, {}, {"error": "no"}, {"condition": 3}, {"condition": "named", "effects": ["?"]}]
)
def test_missing_and_broken_answers_are_scored_as_wrong(broken: Any) -> None:
    one = case("one", broken, BACKLASH)
    assert not one.first and not one.listed
    assert "testable faults missed: backlash 1 (1)" in real_report([one])


def test_the_report_has_every_row_without_cases() -> None:
    assert all(other.reached is None for other in rows_of([]))
    assert "NOT REACHED" not in real_report([])
