"""Known distances that touches contradict: told in the first sentence with both values, and not used."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest

from analysis.apps.report.summary_words import summarise
from analysis.apps.report.texts import LANGUAGES, keys_of, texts_of
from analysis.diagnosis.diagnose import diagnose
from analysis.diagnosis.judge.result import Diagnosis
from analysis.runs.loading import Measured
from rigs.arms import load_arm
from rigs.load import parse
from rigs.rig import Rig
from tests.support.answers import acts_in_words
from tests.support.nightly import cases
from tests.worlds.arms.seven_axes import Fault, draw_truth, run_of, touch_table

_BALL_MM = np.array([3.0, -1.5, 36.0])
_SOCKETS_MM = np.array([[190.0, -70.0, 15.0], [190.0, 65.0, 60.0]])
_TRUE_MM = float(np.linalg.norm(_SOCKETS_MM[1] - _SOCKETS_MM[0]))


def _rig(distance_mm: float | None) -> Rig:
    known = f", distances: [{{between: [A, B], distance_mm: {distance_mm}}}]" if distance_mm else ""
    text = f"name: small\n{load_arm('so-101').text}tests: {{touch: {{sockets: [A, B]{known}}}}}\n"
    return parse(text, "small.yaml")


def _run(rig: Rig, *faults: Fault) -> Measured:
    rng = np.random.default_rng(1)
    return run_of(rig, touch_table(rig.robot, draw_truth(rig.robot, rng, faults), rng, _BALL_MM, _SOCKETS_MM, 40))


@cache
def _found(stated_mm: float | None, *faults: Fault) -> Diagnosis:
    rig = _rig(stated_mm)
    return diagnose(rig, [_run(rig, *faults)], [], [], lambda _: None)


@pytest.mark.parametrize("off_mm", cases((8.0, -0.5 * _TRUE_MM), {8.0}))
def test_a_wrong_distance_is_named_first_with_the_distance_that_the_readings_give(off_mm: float) -> None:
    found = _found(_TRUE_MM + off_mm)
    (made,) = found.contradictions
    assert made.names == ("A", "B") and made.stated.value == pytest.approx(_TRUE_MM + off_mm)
    assert abs(made.by_readings.value - _TRUE_MM) < 3 * made.by_readings.u < 3
    for summary in (summarise(found, texts_of(language)) for language in LANGUAGES):
        assert str(made.stated) in summary.headline and str(made.by_readings) in summary.headline
        assert made.key in summary.next
    assert keys_of(summarise(found).headline)[0] == "finding_contradicted"
    assert summarise(found).next == acts_in_words(found, texts_of("en"))[0]
    assert json.loads(json.dumps(found.to_dict()))["contradictions"][0]["stated"]["value"] == made.stated.value


def test_the_rest_of_the_answer_is_that_without_the_distance() -> None:
    wrong, without = _found(_TRUE_MM + 8.0), _found(None)
    assert wrong.condition == without.condition
    assert wrong.train.calibrated_um == pytest.approx(without.train.calibrated_um, rel=1e-6)


_FAULTS = (None, Fault("zero", 3, 4.0), Fault("length", 3, 6.0, "a"))


@pytest.mark.parametrize("fault", cases(_FAULTS, _FAULTS[1:2]))
def test_a_right_distance_is_not_doubted_whatever_the_arm_has(fault: Fault | None) -> None:
    assert not _found(_TRUE_MM, *([fault] if fault else [])).contradictions


def test_a_scale_of_the_arm_within_its_build_is_no_wrong_distance() -> None:
    """Touches show no common scale of all lengths; a known distance is what shows it."""
    assert not _found(1.005 * _TRUE_MM).contradictions


def test_a_distance_that_was_measured_again_replaces_the_one_recorded_with_the_run() -> None:
    run = _run(_rig(_TRUE_MM + 8.0))
    assert not diagnose(_rig(_TRUE_MM), [run], [], [], lambda _: None).contradictions
