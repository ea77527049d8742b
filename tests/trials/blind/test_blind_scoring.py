"""The scorer on answers made by hand, every verdict among them, and the runner from table to run."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from tests.trials.blind import trial
from tests.trials.blind.answers import CONDITIONS, answer_of, name_in
from tests.trials.blind.scoring import Case, cases_of, confusions, report, rows_of, wilson
from tests.worlds import stranger

BACKLASH = {
    "name": "backlash 1",
    "effect": "backlash",
    "axis": 1,
    "parameters": {"width_deg": 0.05},
    "size": "width_deg",
    "class": ["backlash 1", "servo_lag 1"],
    "nearest_rival": {"name": "reversal_spike 1", "sigma": 9.0},
}
A5 = BACKLASH | {"name": "link_geometry 5.a", "parameters": {"delta": 0.2}, "size": "delta"} | {
    "class": ["joint_offset 5", "link_geometry 5.a"]
}  # fmt: skip
SAID = {"effect": "backlash", "axis": 1, "parameters": {"width_deg": {"value": 0.0505, "sd": 0.001}}, "posterior": 1}
SAID_SMALL = SAID | {"parameters": {"width_deg": {"value": 1e-6, "sd": 1e-7}}}
LEFT = {"held_out": 0.004, "unseen_place": 0.02}


def truth(kind: str, *hidden: dict[str, Any], name: str = "a") -> dict[str, Any]:
    outside = {"name": "dent", "effect": "dent"} if kind == "outside" else None
    return {"case": name, "kind": kind, "hidden": list(hidden), "outside": outside}


def said(condition: str, *effects: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"condition": condition, "effects": list(effects), "left_by_truth": LEFT, "seconds": 1.5} | more


def case(kind: str, answer: Any, *hidden: dict[str, Any]) -> Case:
    return cases_of([truth(kind, *hidden)], {"a": answer})[0]


def value_of(cases: list[Case], figure: str) -> tuple[str, bool | None]:
    row = next(row for row in rows_of(cases) if row.figure.strip() == figure)
    return row.value, row.reached


def test_wilson_interval() -> None:
    """Wilson 1927; 81 of 263 is Newcombe's example (1998): 0.2553 to 0.3662."""
    assert wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=1e-4)
    assert wilson(0, 300)[0] == 0
    assert wilson(0, 300)[1] == pytest.approx(0.01264, abs=1e-4)
    assert wilson(0, 0) == (0.0, 1.0)


def test_names_are_found_wherever_their_keys_stand() -> None:
    assert name_in({"effect": "link_geometry", "axis": 5, "field": "a"}) == "link_geometry 5.a"
    assert name_in({"effect": "link_geometry", "axis": 5.0, "parameters": {"field": "a"}}) == "link_geometry 5.a"
    assert name_in({"effect": "wrist_coupling", "from_axis": 4, "to_axis": 5}) == "wrist_coupling 4>5"
    assert (
        name_in({"effect": "gauge_scale", "axis": None, "parameters": {"gauge": {"value": "g1"}}}) == "gauge_scale g1"
    )
    assert name_in({"effect": "time_lag", "axis": None}) == "time_lag"
    assert name_in({"effect": "gauge_baseline"}) == "gauge_baseline"
    assert name_in({}) == "?"


@pytest.mark.parametrize("condition", CONDITIONS)
def test_only_verdicts_that_stand_by_names_name(condition: str) -> None:
    one = case("one", said(condition, SAID), BACKLASH)
    naming = condition in ("named", "ambiguous")
    assert one.exact is naming
    assert bool(one.answer.effects) is naming
    assert value_of([one], "answers missing or broken")[1] is True
    assert value_of([one], "inside the library, called outside")[1] is (condition != "outside_library")


def test_a_name_of_the_class_counts_and_a_second_name_spoils_it() -> None:
    lag = {"effect": "servo_lag", "axis": 1}
    assert case("one", said("named", lag), BACKLASH).exact
    assert not case("one", said("named", lag, SAID), BACKLASH).exact
    both = case("two", said("ambiguous", lag, {"effect": "joint_offset", "axis": 5}), BACKLASH, A5)
    assert both.exact
    assert value_of([both], "precision")[0].startswith("100.0 %")


def test_rivals_are_in_the_list_and_not_exact() -> None:
    wrong = {"effect": "reversal_spike", "axis": 1, "rivals": [SAID]}
    one = case("one", said("ambiguous", wrong), BACKLASH)
    assert not one.exact
    assert one.listed
    assert confusions([one]) == [("backlash 1", "reversal_spike 1", 1)]


def test_half_right_of_two() -> None:
    one = case("two", said("named", SAID, {"effect": "time_lag"}), BACKLASH, A5)
    assert value_of([one], "precision")[0].startswith("50.0 %")
    assert value_of([one], "recall")[0].startswith("50.0 %")
    assert confusions([one]) == [("link_geometry 5.a", "time_lag", 1)]


def test_healthy_arms_and_foreign_effects() -> None:
    healthy = [case("none", said("nothing_unusual")), case("none", said("named", SAID))]
    assert value_of(healthy, "healthy arm: something named") == ("50.0 % (9.5 … 90.5), 1 of 2", False)
    assert confusions(healthy) == [("-", "backlash 1", 1)]
    foreign = [case("outside", said("outside_library", SAID)), case("outside", said("named", SAID))]
    assert value_of(foreign, "outside the library: flagged")[0].startswith("50.0 %")
    assert value_of(foreign, "wrong name kept")[0].startswith("50.0 %")
    assert confusions(foreign) == [("(dent)", "backlash 1", 1)]


def test_gap_size_cover_and_time() -> None:
    one = [case("one", said("named", SAID), BACKLASH)]
    assert value_of(one, "gap removed, run left out: median") == ("99.60 % of 1", True)
    assert value_of(one, "left at an unseen place: p90") == ("2.00 % of 1", True)
    assert value_of(one, "size: median error") == ("1.00 % of 1", False)
    assert value_of(one, "2-sigma cover")[0].endswith("1 of 1")
    assert value_of(one, "time a case")[1] is True


@pytest.mark.parametrize(
    "broken",
    [None, {}, {"error": "no"}, {"condition": 3}, {"condition": "named", "effects": None, "left_by_truth": None},
     {"condition": "named", "effects": ["?", {}], "left_by_truth": {"held_out": "x", "unseen_place": None}}],
)  # fmt: skip
def test_missing_and_broken_answers_are_scored_as_wrong(broken: Any) -> None:
    one = case("one", broken, BACKLASH)
    assert not one.exact
    assert not one.listed
    assert one.answer.left == {}
    assert "backlash 1" in report([one])


def test_the_report_has_every_row_and_says_when_there_are_no_cases() -> None:
    assert report([]).count("no cases") == len(rows_of([]))
    text = report([case("one", said("named", SAID), BACKLASH), case("none", said("nothing_unusual"))])
    assert "100.0 % (20.7 … 100.0), 1 of 1  reached" in text
    assert math.isnan(answer_of(None).seconds)


def test_a_case_is_imported_blindly_and_its_answer_kept(blind_root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The paths given to a diagnosis contain neither kind nor seed, and the truth is not below them."""
    told = []
    monkeypatch.setattr(trial, "diagnose_case", lambda *runs: told.extend(runs) or said("nothing_unusual", SAID_SMALL))
    job = trial.Job("one", 2, "limits", blind_root)
    answer = trial.run_job(job)
    assert answer["condition"] == "nothing_unusual"
    # What is said in vain leaves all, or a good deal, of what is hidden.
    assert answer["left_by_truth"]["held_out"] > 0.1
    assert [len(runs) for runs in told] == [13, 2, 2]
    assert "one" not in job.name
    assert not [path for path in job.case.rglob("*.json") if "backg" in path.read_text(encoding="utf-8")]
    assert json.loads(job.truth.read_text(encoding="utf-8"))["kind"] == "one"
    assert stranger.KINDS[0] == "none"


def test_a_diagnosis_that_fails_is_a_missing_answer(blind_root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> dict[str, Any]:
        raise RuntimeError("singular")

    monkeypatch.setattr(trial, "diagnose_case", fails)
    answer = trial.run_job(trial.Job("none", 2, "limits", blind_root)) or {}
    assert answer["error"] == "RuntimeError: singular"
    assert answer_of(answer).condition == "none"
