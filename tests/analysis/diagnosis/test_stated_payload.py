import numpy as np
import pytest

from analysis.diagnosis.diagnose import diagnose
from analysis.diagnosis.judge.named import Named
from rigs.arms import load_arm
from rigs.effects import Compliance
from rigs.load import parse
from rigs.rig import Rig
from rigs.schema.effect import Payload, name_of
from tests.worlds.arms.seven_axes import Fault, draw_truth, pose_table, run_of

BALL_MM = np.array([10.0, -5.0, 120.0])


def test_stated_payload_has_a_few_percent_and_may_be_as_wrong_as_a_fit_allows():
    (unknown,), (stated,) = Compliance.free(Payload()), Compliance.free(Payload(8.0))
    assert unknown.spread_from(5.0) == unknown.spread > 5
    assert stated.expected == 0 and stated.spread_from(0.0) == pytest.approx(0.24)
    assert stated.spread_from(15.0) == 15


def test_unknown_payload_scales_with_the_mass_of_the_arm():
    """A payload of 17 kg was assumed for a hobby arm of 0.5 kg, and its softness was 80 times too small."""
    (hobby,), (cobot,) = Compliance.free(Payload(arm_kg=0.5)), Compliance.free(Payload(arm_kg=30.0))
    assert cobot.expected == pytest.approx(5) and hobby.expected == pytest.approx(5 / 60)
    assert max(hobby.tried) + 2 * hobby.spread < 0.5 < min(cobot.tried)
    (stated,) = Compliance.free(Payload(0.1, 0.5))
    assert stated.spread < 0.01


def _rig(payload_kg: float) -> Rig:
    return parse(f"name: cell\n{load_arm('ur10e').text}  payload_kg: {payload_kg}\n", "cell.yaml")


def _found(stated: Rig, really: Rig, seed: int, fault: Fault) -> tuple[Named, float]:
    """Compliance named with the stated rig file, and the true one in °/Nm."""
    rng = np.random.default_rng(seed)
    truth = draw_truth(really.robot, rng, (fault,))
    table = pose_table(really.robot, truth, rng, BALL_MM, 150)
    found = diagnose(stated, [run_of(stated, table)], [], [], lambda _: None)
    named = next(one for one in found.effects if name_of(one.effect) == fault.name)
    return named, float(np.degrees(truth.soft[fault.axis - 1]))


@pytest.mark.nightly  # 7 s
def test_wrong_payload_is_found_if_links_have_masses():
    named, true = _found(_rig(2), _rig(12), 54, Fault("compliance", 2, 0.004))
    assert named.effect.payload_kg == pytest.approx(10, abs=1)
    assert abs(named.effect.deg_per_Nm - true) < 3 * named.sd["deg_per_Nm"] < 0.2 * true
