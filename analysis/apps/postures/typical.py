"""Typical errors of an arm that was not measured: every effect at its healthy size, as an independent displacement."""

from __future__ import annotations

import numpy as np

from analysis.apps.planning.pose_plan import pose_columns
from analysis.diagnosis.fit.candidates import Level
from analysis.robot.kinematics.arm import Array
from rigs.effects import VOCABULARY, Effect
from rigs.rig import Rig
from rigs.schema.effect import healthy, scaled, size_fields

_LEVEL = 1.0
"""Size of the errors relative to a healthy arm. For 1 the model of a UR10 has 1.0 mm rms over its work space;
measured nominal errors of a UR10 are 0.8 to 1.1 mm (docs/trials.md).
"""


def typical_displacements(rig: Rig, q: Array) -> Array:
    """Return independent tool displacements (k, n, 3) mm at joint angles q (n, axes) rad.

    Each is one standard deviation of a typical effect. Backlash is omitted, because it depends on the approach.
    """
    columns, sd_mm = pose_columns(rig.model_copy(update={"effects": ()}).with_calibration(None, None), q)
    variance = columns.variance(Level(_LEVEL))
    variance[columns.fixed > 0] = 0.0  # set-ups and scatter
    scaled = columns.X * np.sqrt(variance) * sd_mm.reshape(-1, 1)
    return np.ascontiguousarray(scaled.reshape(len(q), 3, -1).transpose(2, 0, 1))


def typical_plays(rig: Rig) -> list[Effect]:
    """Return the backlash of every joint at the size typical for the build of the arm."""
    plays = [cls for cls in VOCABULARY.values() if cls.STAGE == "joint" and cls.STRAIGHT == 0]
    of_axes = [
        healthy(cls.model_validate({"axis": axis, size_fields(cls)[0]: 1.0}))
        for cls in plays
        for axis in range(1, len(rig.robot.axes) + 1)
    ]
    return [scaled(play, play.usual_times(rig.reference)) for play in of_axes]
