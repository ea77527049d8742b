import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from analysis.robot.geometry.circle import frame_of, link_readings
from analysis.robot.geometry.driven_programs import circle_of
from rigs.load import load

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "setting-up.md").read_text(encoding="utf-8")
DRAWINGS = sorted((ROOT / "docs" / "images").glob("mechanics-*.svg"))


@pytest.mark.parametrize("path", DRAWINGS, ids=lambda path: path.stem)
def test_a_drawing_is_shown_and_has_colours_for_the_dark(path):
    root = ET.parse(path).getroot()  # noqa: S314 - our own file
    assert root.get("aria-label") and f"images/{path.name}" in PAGE
    style = root.find("{http://www.w3.org/2000/svg}style")
    assert style.text and "prefers-color-scheme: dark" in style.text
    assert root.find("{http://www.w3.org/2000/svg}rect[@class='paper']") is not None


@pytest.mark.parametrize("off_mm", [1.0, 0.5])
def test_residual_of_an_eccentric_ball_is_as_stated(off_mm):
    frame = frame_of(circle_of(load("ur10e-cell")[0]))
    phi = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    ball = frame.centre + off_mm * frame.u
    g_mm = link_readings(frame.poses(phi), ball, np.array([25.0, -25.0]), "yaw", frame.radius)
    angle_deg = np.degrees(np.arctan2(g_mm[:, 1] - g_mm[:, 0], 50.0))
    sine = np.stack([np.ones_like(phi), np.sin(phi), np.cos(phi)], axis=1)
    left_deg = angle_deg - sine @ np.linalg.lstsq(sine, angle_deg, rcond=None)[0]
    assert f"{np.ptp(left_deg):.3f}° at {off_mm:g} mm" in PAGE


def test_there_are_drawings():
    assert len(DRAWINGS) == 3
