"""Second order: the two waves a lap that remain in the angle when its sine, the first order, is left out.

A tool that is carried around an ellipse instead of a circle shows them, as where the gains of two axes differ.

Figures: second_order_deg, the amplitude of these waves; second_order_at_deg, the circle angle of their first maximum.
"""

from __future__ import annotations

import numpy as np

from analysis.robot.kinematics.arm import Array
from analysis.runs.noise.spectrum import NODES


def second_order_figures(y: Array, _radius_mm: float) -> dict[str, Array]:
    """Amplitude (...,) and place (...,) in degrees of the second order of angles y (..., NODES) rad."""
    wave = 2 * np.fft.rfft(y)[..., 2] / NODES
    return {
        "second_order_deg": np.degrees(np.abs(wave)),
        "second_order_at_deg": np.degrees(-np.angle(wave) / 2) % 180,
    }
