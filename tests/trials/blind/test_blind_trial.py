"""A small fixed sample of the blind trial (`scripts/dev blind` is the whole): of each kind a verdict and its names."""

import json

import pytest

from rigs.errors import FileError
from tests.support.nightly import cases
from tests.trials.blind import trial
from tests.trials.blind.trial import Job, run_job

CASES = [
    ("healthy", 103, "uncalibrated"),
    ("healthy", 99800, "uncalibrated"),  # a spike that fades in 0.9 s was a lag of the gauges, of 33 ms for 0.6
    ("one", 200, "named"),
    ("foreign_large", 201, "outside_library"),
]
"""Development seeds of the real world."""


@pytest.mark.parametrize(("kind", "seed", "condition"), cases(CASES, ()))
def test_a_blind_case_is_diagnosed_as_the_scorer_has_it(kind, seed, condition, blind_root):
    job = Job(kind, seed, blind_root)
    answer = run_job(job)
    assert "error" not in answer, answer
    assert answer["condition"] == condition
    hidden = json.loads(job.truth.read_text(encoding="utf-8"))["hidden"]
    standing = [one for one in answer["effects"] if one["stands"]]
    assert [one["name"] for one in standing] == [one["name"] for one in hidden]
    for one, said in zip(hidden, standing, strict=True):
        size = said["parameters"][one["size"]]
        assert abs(size["value"] - one["parameters"][one["size"]]) < 5 * size["sd"]
        assert said["held_out_gain"] > 0


def test_refused_tables_are_a_missing_answer(tmp_path, monkeypatch):
    def refused(_: Job) -> None:
        raise FileError("a.csv", "gauges", "exchange")

    job = Job("one", 3, tmp_path)
    job.case.mkdir(parents=True)
    job.truth.parent.mkdir()
    job.truth.write_text(json.dumps({"hidden": []}))
    monkeypatch.setattr(trial, "make_case", refused)
    assert "gauges" in run_job(job)["error"]
    assert "gauges" in json.loads((job.case / "answer.json").read_text())["error"]
