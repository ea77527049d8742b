from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.worlds.unknown.arms import Arm, Array, elbow_arm, forward, gravity_torque, point, seven_axis_arm, ur10e
from tests.worlds.unknown.causes import CAUSES, TorsionHysteresis
from tests.worlds.unknown.cells import (
    LEAST_NOISES,
    Noise,
    draw_cell,
    motions,
    no_known,
    noise_um,
    seen_without_noise,
    sight_of,
)
from tests.worlds.unknown.files import write_cell
from tests.worlds.unknown.motion import stops

QUIET = Noise(1e-9, 1e-9, 1e-9, 1e-12)


def postures(arm: Arm, count: int = 20) -> Array:
    return np.random.default_rng(3).uniform(arm.low, arm.high, (count, arm.axes))


def by_screws(axes: list[tuple[Array, Array]], end: Array, q: Array) -> Array:
    """Return positions (n, 3) of the flange by a product of exponentials of the axes (point, direction) at zero."""
    found = []
    for angles in q:
        p = end
        for (at, way), angle in reversed(list(zip(axes, angles, strict=True))):
            p = Rotation.from_rotvec(angle * way).apply(p - at) + at
        found.append(p)
    return np.array(found)


def screws(rows: list[tuple[tuple[float, float, float], tuple[float, float, float]]]) -> list[tuple[Array, Array]]:
    return [(np.array(at, dtype=float), np.array(way, dtype=float)) for at, way in rows]


UR10E = screws([
    ((0, 0, 0), (0, 0, 1)),
    ((0, 0, 180.7), (0, -1, 0)),
    ((-612.7, 0, 180.7), (0, -1, 0)),
    ((-1184.25, 0, 180.7), (0, -1, 0)),
    ((-1184.25, -174.15, 0), (0, 0, -1)),
    ((-1184.25, 0, 60.85), (0, -1, 0)),
])  # fmt: skip
SEVEN = screws([
    ((0, 0, 0), (0, 0, 1)),
    ((0, 0, 360), (0, 1, 0)),
    ((0, 0, 0), (0, 0, 1)),
    ((0, 0, 780), (0, -1, 0)),
    ((0, 0, 0), (0, 0, 1)),
    ((0, 0, 1180), (0, 1, 0)),
    ((0, 0, 0), (0, 0, 1)),
])  # fmt: skip


@pytest.mark.parametrize(
    ("arm", "axes", "end"),
    [(ur10e(), UR10E, (-1184.25, -290.7, 60.85)), (seven_axis_arm(), SEVEN, (0.0, 0.0, 1306.0))],
    ids=["UR10e", "seven axes"],
)
def test_arms_agree_with_their_drawings(arm, axes, end):
    q = postures(arm)
    np.testing.assert_allclose(forward(arm, q).flange[:, :3, 3], by_screws(axes, np.array(end), q), atol=1e-8)


def test_elbow_arm_agrees_with_the_closed_form_of_ortho_parallel_arms():
    """Brandstötter, Angerer and Hofbaur, An analytical solution of the inverse kinematics problem of industrial serial
    manipulators with an ortho-parallel basis and a spherical wrist (2014): forward equations of the wrist centre."""
    arm = elbow_arm()
    q = postures(arm)
    a1, a2, c1, c2, c3, c4 = 25.0, -35.0, 400.0, 560.0, 515.0, 80.0
    t1, t2, t3 = q[:, 0], q[:, 1] + np.pi / 2, q[:, 2] + np.pi / 2
    psi, k = np.arctan2(a2, c3), np.hypot(a2, c3)
    out = c2 * np.sin(t2) + k * np.sin(t2 + t3 + psi) + a1
    centre = np.stack([out * np.cos(t1), out * np.sin(t1), c1 + c2 * np.cos(t2) + k * np.cos(t2 + t3 + psi)], axis=1)
    flange = forward(arm, q).flange
    np.testing.assert_allclose(flange[:, :3, 3] - c4 * flange[:, :3, 2], centre, atol=1e-8)


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


@pytest.fixture(params=["circle", "touch"])
def perfect(request):
    cell = draw_cell(0).sound()
    return replace(cell, test=request.param, known=no_known(6), noise=QUIET, target=np.zeros(3), frame=np.eye(4))


def test_rig_reads_a_perfect_cell_without_a_residual(perfect, tmp_path):
    """The only test with rig: frames, signs and units agree. Tables are rounded to 0.1 µm."""
    from analysis import compare, read_table  # noqa: PLC0415

    for path, test, direction in write_cell(perfect, tmp_path):
        found = compare([read_table(path, tmp_path / "cell.yaml", test, direction or None)])
        for run in found.runs:
            assert np.abs(run.residuals_mm).max() < 5e-4
        for pose in found.poses:
            assert pose.largest_um < 0.5
        assert found.runs or found.poses
