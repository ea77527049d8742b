"""Stated probabilities of kept answers, their classes, and the fit of the calibration."""

import json
from argparse import Namespace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.trials.stated_odds import Stated, brier_score, classes_of, fitted_calibration, judged, stated_in
from tests.worlds.unknown.cells import draw_cell

BACKLASH = {"name": "backlash 1", "effect": "backlash", "parameters": {"width_deg": 0.1}, "size": "width_deg"}


def named(name: str, key: str, value: float, probability: float, log_odds: float = 3.0) -> dict[str, Any]:
    parameters = {key: {"value": value, "sd": 1e-4}}
    return {"name": name, "parameters": parameters, "posterior": probability, "log_odds": log_odds}


def keep_blind(root: Path, number: int, *effects: dict[str, Any], background: Any = ()) -> None:
    case = root / "cases" / f"case-{number}"
    case.mkdir(parents=True)
    (root / "truth").mkdir(exist_ok=True)
    hidden = [BACKLASH | {"testable": True, "class": ["backlash 1"]}]
    truth = {"case": case.name, "kind": "one", "seed": number, "hidden": hidden, "outside": []}
    (root / "truth" / f"{case.name}.json").write_text(json.dumps(truth | {"background": list(background)}))
    (case / "answer.json").write_text(json.dumps({"condition": "named", "effects": effects}))


def stated(probability: float, is_right: bool, log_odds: float | None = None) -> Stated:
    return Stated("known", "circles", "case", 1, "backlash 1", probability, log_odds, is_right)


def test_fault_healthy_size_and_absent_effect_are_right_right_and_wrong(tmp_path):
    wave = {"name": "transmission_error 2", "effect": "transmission_error", "healthy": 0.005}
    wave |= {"parameters": {"amplitude_deg": 0.004, "order": 7.0}}
    found = named(wave["name"], "amplitude_deg", 0.005, 0.9)
    piece = found | {"parameters": found["parameters"] | {"order": {"value": 14.0, "sd": 0.1}}}
    found["parameters"]["order"] = {"value": 7.01, "sd": 0.01}
    effects = [named("backlash 1", "width_deg", 0.1, 0.99), found, piece, named("time_lag", "lag_s", 0.01, 0.6)]
    keep_blind(tmp_path, 1, *effects, background=[wave])
    (tmp_path / "cases" / "case-begun").mkdir()
    assert [(one.name, one.is_right) for one in stated_in(tmp_path)] == [
        ("backlash 1", True), ("transmission_error 2", True), ("time_lag", False),
    ]  # fmt: skip


def test_related_name_of_unknown_cause_is_omitted(tmp_path):
    cell = draw_cell(0)  # cubic torsion of axis 2
    zero = cell.known.names()["joint_offset 3"]
    effects = [
        named("joint_offset 3", "offset_deg", zero, 0.97),
        named("compliance 2", "deg_per_Nm", 1e-3, 0.99) | {"axis": 2},
    ]
    for arm in ("with", "sound"):
        (tmp_path / "cell-0" / arm).mkdir(parents=True)
        (tmp_path / "cell-0" / arm / "answer.json").write_text(json.dumps({"effects": effects}))
    found = [(one.world, one.readings, one.name, one.is_right) for one in stated_in(tmp_path)]
    assert found == [
        ("known", "poses", "joint_offset 3", True),
        ("known", "poses", "compliance 2", False),
        ("unknown", "poses", "joint_offset 3", True),
    ]


def test_classes_contain_their_upper_limit():
    names = [stated(0.0, False), stated(0.5, True), stated(0.95, True), stated(0.951, False), stated(1.0, True)]
    assert [(one.names, one.right) for one in classes_of(names)] == [(2, 1), (0, 0), (1, 1), (1, 0), (1, 1)]
    assert brier_score(names[-1:]) == 0 and brier_score(names[1:2]) == pytest.approx(0.25)


def test_fit_recovers_the_logistic_function():
    rng = np.random.default_rng(1)
    log_odds = rng.uniform(-5, 15, 4000)
    is_right = rng.random(4000) < 1 / (1 + np.exp(1.0 - 0.5 * log_odds))
    names = [stated(0.5, bool(right), float(x)) for x, right in zip(log_odds, is_right, strict=True)]
    assert fitted_calibration(names) == pytest.approx((-1.0, 0.5), abs=0.15)


def test_kept_answers_make_table_diagram_and_calibration(tmp_path):
    for number in range(3):
        wrong = named("time_lag", "lag_s", 0.01, 0.6, 0.2)
        keep_blind(tmp_path, number, named("backlash 1", "width_deg", 0.1, 0.995), wrong)
    picture, file = tmp_path / "odds.png", tmp_path / "calibration.json"
    said = judged(Namespace(keep=[tmp_path], picture=picture, fit=file, calibration=None))
    assert "3 of 3" in said and "Brier score" in said
    assert picture.read_bytes().startswith(b"\x89PNG")
    again = judged(Namespace(keep=[tmp_path], picture=None, fit=None, calibration=file))
    assert "6 of 6" not in again and "3 of 6" in again
    content = json.loads(file.read_text())
    assert (content["cells"], content["names"], content["seeds"]) == (3, 6, [0, 2]) and content["slope"] > 0
