"""Joint zero offset: the paper's datum location error."""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Array
from rigs.effects import JointOffset


def deviation(effect: JointOffset, q: Array) -> Array:
    """Link side less reported, (n,) rad: a constant."""
    return np.full(len(q), np.radians(effect.offset_deg))
