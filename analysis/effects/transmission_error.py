"""Transmission error: a gear that runs ahead and behind with the angle of the joint."""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Array
from rigs.effects import TransmissionError


def deviation(effect: TransmissionError, q: Array) -> Array:
    """Link side less reported, (n,) rad: A sin(N q + phase)."""
    phase = effect.order * q + np.radians(effect.phase_deg)
    error: Array = np.radians(effect.amplitude_deg) * np.sin(phase)
    return error
