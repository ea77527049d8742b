"""Typical errors of an arm that was not measured: the healthy size of every effect as an independent displacement."""

from __future__ import annotations

import numpy as np

from analysis.diagnosis.plan.pose_plan import pose_columns
from analysis.robot.kinematics.arm import Array
from rigs.effects.backlash import Backlash
from rigs.rig import Rig

_LEVEL = 1.0
"""Size of the errors relative to a healthy arm: 1 gives a UR10 1.0 mm rms over its workspace. The measured nominal
errors of one are 0.8 to 1.1 mm (docs/trials.md)."""


def typical_displacements(rig: Rig, q: Array) -> Array:
    """Return independent tool displacements (k, n, 3) mm at joint angles q (n, axes) rad.

    Each displacement is one standard deviation of a typical effect. Play is left out: it depends on the approach.
    """
    columns, sd_mm = pose_columns(rig.model_copy(update={"effects": ()}).with_calibration(None, None), q)
    variance = columns.variance(_LEVEL)
    variance[columns.fixed > 0] = 0.0  # set-ups and scatter
    scaled = columns.X * np.sqrt(variance) * sd_mm.reshape(-1, 1)
    return np.ascontiguousarray(scaled.reshape(len(q), 3, -1).transpose(2, 0, 1))


def typical_play_rad(rig: Rig) -> float:
    """Return the typical play of a joint of an arm of this build."""
    play = Backlash(axis=1, width_deg=0.0)
    return float(np.radians(play.healthy * play.usual_times(rig.robot.built)))
