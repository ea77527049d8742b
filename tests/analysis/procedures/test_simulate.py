import numpy as np
import pytest

from analysis.procedures.shared.test_kind import Noise
from analysis.procedures.simulate import simulate
from rigs.effects import VOCABULARY, healthy_size, size_field
from rigs.load import load
from rigs.rig import Rig


def _of_laps(laps: int, speed_mm_s: float) -> Rig:
    rig, _ = load("ur10e-cell")
    circle = rig.tests.circle
    driven = circle.model_copy(update={"laps": laps, "speed_mm_s": speed_mm_s})
    return rig.model_copy(update={"tests": rig.tests.model_copy(update={"circle": driven})})


def test_the_wander_is_slow_and_common_to_both_gauges():
    """Without gauge noise and scatter only the drift remains: equal in both gauges, with the stated time constant."""
    rig = _of_laps(20, 25.0)
    quiet = rig.model_copy(
        update={
            "gauges": rig.gauges.model_copy(
                update={name: gauge.model_copy(update={"accuracy_mm": 0.0}) for name, gauge in rig.gauges}
            )
        }
    )
    noise = Noise(wander_mm=0.001, wander_s=0.5, scatter_deg=0.0, scatter_mm=0.0)
    noisy, exact = (simulate(quiet, "yaw", "acw", seed, [], noise) for seed in (3, None))
    wander = noisy.g_mm - exact.g_mm
    np.testing.assert_allclose(wander[:, 0], wander[:, 1], atol=1e-12)
    assert np.std(wander[:, 0]) == pytest.approx(0.001, rel=0.2)
    later = wander[25:, 0] @ wander[:-25, 0] / (wander[:, 0] @ wander[:, 0])
    assert later == pytest.approx(np.exp(-1), abs=0.15)


@pytest.mark.parametrize("name", ["time_lag", "clock_rate", "servo_lag", "reversal_spike"])
@pytest.mark.parametrize("test", ["radial", "repeatability"])
def test_a_robot_that_stands_shows_no_lag(name, test):
    rig = load("paper-fanuc")[0]
    fields = {"axis": 1} if "axis" in VOCABULARY[name].model_fields else {}
    effect = VOCABULARY[name].model_validate(fields)
    large = effect.model_copy(update={size_field(effect): 10 * healthy_size(effect)})
    nothing = simulate(rig, test, None, None, ()).g_mm
    shown = simulate(rig, test, None, None, (large,)).g_mm
    assert np.abs(shown - nothing).max() < 0.02
