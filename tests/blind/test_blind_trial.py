"""A small fixed sample of the blind trial (scripts/blind runs the whole one): of each kind a verdict and its names."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from scoring import cases_of
from trial import Job, run_job

CASES = [
    ("none", 2, "within_tolerance"),
    ("one", 2, "named"),
    ("two", 0, "named"),
    ("outside", 0, "outside_library"),
]
"""Development seeds; what is hidden has no rival nearer than 7 sigma."""


@pytest.mark.timeout(300)
@pytest.mark.parametrize(("kind", "seed", "verdict"), CASES)
def test_a_blind_case_is_diagnosed_as_the_scorer_has_it(kind: str, seed: int, verdict: str, blind_root: Path) -> None:
    job = Job(kind, seed, "limits", blind_root)
    answer = run_job(job)
    assert "error" not in answer, answer
    (case,) = cases_of([json.loads(job.truth.read_text(encoding="utf-8"))], {job.name: answer})
    assert case.answer.verdict == verdict
    names = [named.name for named in case.answer.effects]
    if kind in ("none", "outside"):
        assert names == []
        return
    assert case.exact and case.listed, (case.hidden, names)
    for one, named in case.pairs():
        value, sd = named.parameters[one["size"]]
        assert abs(value - one["parameters"][one["size"]]) < 5 * sd + 0.1 * abs(value)
    assert case.answer.left["held_out"] < 0.1 and case.answer.left["unseen_place"] < 0.3
