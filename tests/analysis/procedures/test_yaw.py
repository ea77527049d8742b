import numpy as np
import pytest

from analysis.procedures.circle import fit_sine
from analysis.procedures.shared.lap_curve import nodes_of
from analysis.robot.geometry.circle import CircleFrame, link_angle, link_readings

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
    phi = np.concatenate(
        [np.linspace(0, np.pi, 2000, endpoint=False), np.linspace(np.pi, 2 * np.pi, 200, endpoint=False)]
    )
    y = 0.1 + 0.02 * np.sin(phi + 1) + 0.05 * np.sin(2 * phi) + 0.03 * np.cos(3 * phi)
    for order in (slice(None), slice(None, None, -1)):
        sine = fit_sine(nodes_of(phi[order], y[order]))
        assert (sine.A, np.hypot(sine.a, sine.b), np.arctan2(sine.b, sine.a)) == pytest.approx(
            (0.1, 0.02, 1.0), abs=2e-4
        )
