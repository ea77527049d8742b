from functools import cache

import numpy as np
import pytest

from analysis.diagnosis.diagnose import diagnose
from analysis.diagnosis.evidence.blocks import blocks_of
from analysis.diagnosis.evidence.gather import prepare_runs
from analysis.diagnosis.evidence.setups import fit_run_setups
from analysis.diagnosis.fit.responses import linearise
from analysis.diagnosis.judge.result import Diagnosis
from analysis.runs.loading import Measured
from rigs.arms import load_arm
from rigs.load import parse
from rigs.rig import Rig
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
    return run_of(rig, touch_table(rig.robot, draw_truth(rig.robot, rng, faults), rng, _BALL_MM, _SOCKETS_MM, 25))


@cache
def _found(stated_mm: float | None, *faults: Fault) -> Diagnosis:
    rig = _rig(stated_mm)
    return diagnose(rig, [_run(rig, *faults)], [], [], lambda _: None)


def test_a_wrong_distance_is_named_first_with_the_distance_that_the_readings_give():
    found = _found(_TRUE_MM + 8.0)
    (made,) = found.contradictions
    assert made.names == ("A", "B") and made.stated.value == pytest.approx(_TRUE_MM + 8.0)
    assert abs(made.by_readings.value - _TRUE_MM) < 3 * made.by_readings.u < 3
    assert found.to_dict()["contradictions"][0]["stated"]["value"] == made.stated.value


def test_correct_distance_is_not_doubted_despite_a_fault_of_the_arm():
    assert not _found(_TRUE_MM, Fault("zero", 3, 4.0)).contradictions


def test_a_distance_that_was_measured_again_replaces_the_one_recorded_with_the_run():
    run = _run(_rig(_TRUE_MM + 8.0))
    assert not diagnose(_rig(_TRUE_MM), [run], [], [], lambda _: None).contradictions


BALL_MM = np.array([10.0, -5.0, 120.0])
SOCKETS = np.array([[450.0, -200.0, 150.0], [450.0, 100.0, 150.0], [-100.0, 500.0, 300.0]])
KNOWN = "{sockets: [A, B, C], distances: [{between: [B, A], distance_mm: 300, u_mm: 0.02}]}"
RIG = parse(f"name: seven\n{load_arm('franka-fr3').text}tests: {{touch: {KNOWN}}}\n", "seven.yaml")


def test_all_placements_share_the_error_of_a_known_distance():
    rng = np.random.default_rng(3)
    touches = touch_table(RIG.robot, draw_truth(RIG.robot, rng, ()), rng, BALL_MM, SOCKETS, 45)
    runs = [run_of(RIG, touches, name, place) for name, place in (("one", "left"), ("two", "right"))]
    (seen,), _ = prepare_runs(RIG, runs)
    setups, _ = fit_run_setups(seen)
    linear = linearise(blocks_of(seen, setups), setups)
    assert linear.distances.pairs == (
        ("touch at left, socket A", "touch at left, socket B"),
        ("touch at right, socket A", "touch at right, socket B"),
    )
    assert linear.distances.scatter.shape == (2, 1)
    step = np.zeros(linear.U.shape[1])
    step[linear.terms["touch at right, socket B"][:3]] = 1e-3, 2e-3, -3e-3
    changed = linear.distances.residual(linear.setups_moved_by(step)) - linear.distances.residual(setups)
    np.testing.assert_allclose(linear.U[linear.of_distances] @ step, -changed, atol=1e-5)
    assert abs(changed[0]) < 1e-12 < abs(changed[1])
