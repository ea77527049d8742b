import numpy as np
import pytest

from analysis.apps.emulate.robot import trace
from analysis.procedures.circle import Yaw, fit_sine
from analysis.procedures.shared.lap_curve import nodes_of
from analysis.robot.geometry.circle import CircleFrame, frame_of, link_angle, link_readings
from analysis.robot.geometry.driven_programs import circle_of
from analysis.runs.laps import Laps
from rigs.load import load, load_hidden

PHI = np.linspace(0, 2 * np.pi, 900, endpoint=False)
FRAME = CircleFrame(np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), np.array([0, 0, 1.0]), 70.0)
OFFSETS = np.array([25.0, -25.0])


def test_the_papers_example_of_eccentricity():
    """Section 2.1: e = 14.142 mm at R = 70 mm gives 11.56° by the rule, asin(e/R) exactly."""
    ball = np.array([10.0, 10.0, 0.0])
    T = FRAME.poses(PHI)
    g = link_readings(T, ball, OFFSETS, "yaw", 70.0)
    measured = np.degrees(link_angle(g[:, 0], g[:, 1], 50.0))
    assert measured.max() == pytest.approx(np.degrees(np.arcsin(14.142 / 70)), abs=1e-3)
    sine = fit_sine(nodes_of(PHI, np.radians(measured)))
    assert np.degrees(np.hypot(sine.a, sine.b)) == pytest.approx(206.26481 * 14142.136 / 70 / 3600)


def test_readings_give_the_angle_at_any_eccentricity():
    """angle = atan((g2 - g1)/b) is exact, and both gauges together follow the distance."""
    ball = np.array([3.0, -2.0, 5.0])
    T = FRAME.poses(PHI)
    line = ball - T[:, :3, 3]
    yaw = np.arctan2(np.einsum("ni,ni->n", line, T[:, :3, 1]), np.einsum("ni,ni->n", line, T[:, :3, 2]))
    g = link_readings(T, ball, OFFSETS, "yaw", 70.0)
    np.testing.assert_allclose(link_angle(g[:, 0], g[:, 1], 50.0), yaw, atol=1e-12)
    roll = np.arctan2(np.einsum("ni,ni->n", line, T[:, :3, 0]), np.einsum("ni,ni->n", line, T[:, :3, 2]))
    g = link_readings(T, ball, OFFSETS, "roll", 70.0)
    np.testing.assert_allclose(link_angle(g[:, 0], g[:, 1], 50.0), roll, atol=1e-12)


def test_the_sine_is_the_papers_and_its_shift_keeps_the_quadrant():
    for shift in np.radians([10, 100, -100, -10]):
        sine = fit_sine(nodes_of(PHI, 0.1 + 0.2 * np.sin(PHI + shift)))
        assert (sine.A, np.hypot(sine.a, sine.b), np.arctan2(sine.b, sine.a)) == pytest.approx((0.1, 0.2, shift))


def test_dense_rows_do_not_bias_a_sine():
    """Half of the lap has ten times the density; the residual there must not bias the sine."""
    phi = np.concatenate(
        [np.linspace(0, np.pi, 2000, endpoint=False), np.linspace(np.pi, 2 * np.pi, 200, endpoint=False)]
    )
    y = 0.1 + 0.02 * np.sin(phi + 1) + 0.05 * np.sin(2 * phi) + 0.03 * np.cos(3 * phi)
    for order in (slice(None), slice(None, None, -1)):
        sine = fit_sine(nodes_of(phi[order], y[order]))
        assert (sine.A, np.hypot(sine.a, sine.b), np.arctan2(sine.b, sine.a)) == pytest.approx(
            (0.1, 0.02, 1.0), abs=2e-4
        )


def test_stated_u_covers_the_truth():
    """120 laps of a shipped robot with noise, a lag and a baseline drawn as stated: each figure within 2 u."""
    rig = load_hidden("ur10e").apply_to(load("ur10e")[0])
    driven = trace(rig, "acw")
    lap = (driven.phi >= 0) & (driven.phi < 2 * np.pi) & (driven.t_s < 20)
    t, phi, q, g = driven.t_s[lap], driven.phi[lap], driven.q[lap], driven.g_mm[lap]
    frame, rng = frame_of(circle_of(rig)), np.random.default_rng(5)
    truth = Yaw().plain_figures(phi, link_angle(g[:, 0], g[:, 1], 50.0), frame.radius)
    repetitions, u_lag, u_baseline, noise_mm, every = 120, 2e-3, 0.02, 0.002, 2
    covered = dict.fromkeys(truth, 0)
    for _ in range(repetitions):
        at = np.arange(rng.integers(every), len(t), every)
        late = t[at] + rng.normal(0, u_lag)
        phi_seen = np.interp(late, driven.t_s, driven.phi)
        baseline = 50.0 + rng.normal(0, u_baseline)
        middle, half = g[at].mean(axis=1), (g[at, 0] - g[at, 1]) / 2 * baseline / 50.0
        seen = np.stack([middle + half, middle - half], axis=1) + rng.normal(0, noise_mm, (len(at), 2))
        lap_s = float(np.ptp(t[at]))
        result = Yaw().evaluate_laps(
            Laps("acw", frame, t[at], phi_seen, q[at], seen, lap_s, lap_s), 50.0, u_baseline, u_lag
        )
        for figure, found in result.figures.items():
            covered[figure] += abs(found.value - truth[figure]) <= 2 * found.u
    for figure, count in covered.items():
        assert 0.88 * repetitions <= count, (figure, count)
