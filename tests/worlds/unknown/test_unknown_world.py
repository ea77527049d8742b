from dataclasses import replace

import numpy as np
import pytest

from tests.worlds.unknown.arms import Arm, Array, elbow_arm, forward, gravity_torque, point, seven_axis_arm, ur10e
from tests.worlds.unknown.causes import CAUSES, TorsionHysteresis
from tests.worlds.unknown.cells import (
    LEAST_NOISES,
    Noise,
    draw_cell,
    motions,
    no_known,
    noise_um,
    nominal_arm,
    seen_without_noise,
    sight_of,
)
from tests.worlds.unknown.files import write_cell
from tests.worlds.unknown.motion import stops

QUIET = Noise(1e-9, 1e-9, 1e-9, 1e-12)


def postures(arm: Arm, count: int = 20) -> Array:
    return np.random.default_rng(3).uniform(arm.low, arm.high, (count, arm.axes))


@pytest.mark.parametrize("make", [ur10e, elbow_arm, seven_axis_arm])
def test_gravity_torque_is_the_slope_of_the_potential(make):
    arm = replace(make(), payload_kg=3.0)
    q, step = postures(arm, 5), 1e-5

    def potential(at: Array) -> Array:
        chain = forward(arm, at)
        heights = np.stack([point(chain.link[:, k], arm.centre[k])[:, 2] for k in range(arm.axes)], axis=1)
        return 9.80665e-3 * (heights @ arm.mass + arm.payload_kg * chain.flange[:, 2, 3])

    for k in range(arm.axes):
        more = step * np.eye(arm.axes)[k]
        slope = (potential(q + more) - potential(q - more)) / (2 * step)
        np.testing.assert_allclose(gravity_torque(arm, q)[:, k], -slope, atol=1e-5)


@pytest.mark.parametrize("seed", range(len(CAUSES)), ids=[kind.kind for kind in CAUSES])
def test_each_cause_can_be_seen_and_vanishes_at_size_0(seed):
    cell = draw_cell(seed)
    assert cell.cause.kind == CAUSES[seed].kind
    planned = motions(cell)
    sound = seen_without_noise(cell.sound(), planned)
    seen = seen_without_noise(cell, planned) - sound
    basis = sight_of(cell.sound()).basis
    rest = seen - basis @ np.linalg.lstsq(basis, seen)[0]
    assert 1e3 * np.sqrt(np.mean(rest**2)) >= LEAST_NOISES * noise_um(cell)
    gone = replace(cell, cause=cell.cause.resized(0.0))
    np.testing.assert_allclose(seen_without_noise(gone, planned), sound, atol=1e-9)


def test_a_memory_remembers_and_a_posture_does_not():
    """In the same posture, hysteresis depends on the direction of arrival and a wandering axis does not."""
    arm = ur10e()
    here, low, high = (np.radians([0, angle, 80, -80, -80, 0]) for angle in (-70.0, -130.0, -20.0))
    motion = stops(np.array([here, low, here, high, here]))
    for kind, differs in ((TorsionHysteresis, True), (CAUSES[2], False)):
        cause = kind.draw(np.random.default_rng(1), arm)
        cause = replace(cause, axis=2)
        deviation = cause.deviation(arm, motion).take(motion.rows[[2, 4]])
        change = np.abs(np.diff(np.concatenate([deviation.joint, deviation.before[:, 1]], axis=1), axis=0)).max()
        assert (change > 1e-5) == differs


@pytest.fixture(params=["ur10e circle", "ur10e touch", "elbow pose", "seven pose"])
def perfect(request):
    """Perfect cells; poses have a tracker with noise, since rig refuses places that a controller computed."""
    arm_name, test = request.param.split()
    cell = replace(draw_cell(0).sound(), arm_name=arm_name, known=no_known(nominal_arm(arm_name, test).axes))
    if test == "pose":
        return replace(cell, noise=replace(QUIET, reading_mm=0.01))
    return replace(cell, test=test, noise=QUIET, target=np.zeros(3), frame=np.eye(4))


def test_rig_reads_a_perfect_cell_without_a_residual(perfect, tmp_path):
    """The only test with rig: frames, signs and units agree. Tables are rounded to 0.1 µm."""
    from analysis import compare, read_table  # noqa: PLC0415

    largest_mm = 6 * perfect.noise.reading_mm + 5e-4
    for path, test, direction in write_cell(perfect, tmp_path):
        found = compare([read_table(path, tmp_path / "cell.yaml", test, direction or None)])
        for run in found.runs:
            assert np.abs(run.residuals_mm).max() < largest_mm
        for pose in found.poses:
            assert pose.largest_um < 1e3 * largest_mm
        assert found.runs or found.poses
