import numpy as np
import pytest

from analysis.correction.calibrated_arm import CalibratedArm
from analysis.procedures.simulate import simulate
from analysis.robot.kinematics.arm import Array
from rigs.effects import Compliance, StrainWave
from rigs.effects.strain_wave import three_regions
from rigs.load import load
from rigs.schema.effect import name_of
from rigs.schema.scene import play
from tests.support.diagnosis_cells import found_in
from tests.support.pose_runs import pose_run

RIG = load("ur10e-cell")[0]
T1, T2, K1, K2, K3 = 54.0, 196.0, 13e4, 20e4, 23e4
"""Size 40 of the catalogue, Nm and Nm/rad."""


def _catalogue(torque: Array) -> Array:
    """The twist (n,) rad as the catalogue computes it, region by region."""
    twist = [
        t / K1 if t <= T1 else T1 / K1 + (t - T1) / K2 if t <= T2 else T1 / K1 + (T2 - T1) / K2 + (t - T2) / K3
        for t in np.abs(torque).tolist()
    ]
    return np.sign(torque) * np.array(twist)


def test_torsion_agrees_with_the_catalogue_within_a_few_percent():
    torque = np.linspace(-300, 300, 121)
    assert three_regions(torque, T1) / K1 == pytest.approx(_catalogue(torque), rel=0.03)
    assert three_regions(torque[np.abs(torque) <= T1], T1) == pytest.approx(torque[np.abs(torque) <= T1])


def test_the_loss_opens_a_loop_as_wide_as_it_states():
    up = np.linspace(-60, 60, 241)
    torque = np.concatenate([up, up[::-1], up])
    twist = three_regions(play(torque, 0.3 * 40), 40)
    forward, back = np.interp(0, up, twist[482:]), np.interp(0, up, twist[241:482][::-1])
    assert back - forward == pytest.approx(2 * 0.3 * 40)


def _poses() -> Array:
    """Joints (n, 6) rad of an elbow arm that reaches far and near, up and down."""
    low, high = np.radians([(-85, -170, 20, -120, -110, -150), (85, -10, 120, -40, -50, 150)])
    return np.random.default_rng(4).uniform(low, high, (120, 6))


@pytest.mark.parametrize(
    ("planted", "name"),
    [
        (StrainWave(axis=2, deg_per_Nm=4e-3, knee_Nm=30), "strain_wave 2"),
        (Compliance(axis=2, deg_per_Nm=4e-3), "compliance 2"),
    ],
)
def test_gear_with_knees_differs_from_linear_softness(planted, name):
    q = _poses()
    rig = RIG.model_copy(update={"effects": (planted,)})
    places = CalibratedArm(rig).forward(np.degrees(q)).T[:, :3, 3]
    noise = np.random.default_rng(5).normal(0, 0.03, places.shape)
    found = found_in([pose_run("ur10e", q, places + noise)], RIG)
    assert [name_of(named.effect) for named in found.standing] == [name]
    (named,) = found.standing
    if isinstance(named.effect, StrainWave):
        assert named.effect.knee_Nm == pytest.approx(30, abs=6)


def test_it_is_simulated_on_circles_with_its_history():
    still, lossy = (
        simulate(RIG, "yaw", "acw", None, (StrainWave(axis=3, deg_per_Nm=4e-3, knee_Nm=10, loss=loss),)).g_mm
        for loss in (0.0, 0.5)
    )
    assert np.abs(still - lossy).max() > 1e-3
