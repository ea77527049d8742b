from __future__ import annotations

from typing import Literal

import numpy as np

from rigs.schema.effect import OF_THE_GAUGES, Effect, Scope, size
from rigs.schema.scene import S


class GaugeBaseline(Effect):
    """Distance between the gauges larger than in the rig file."""

    effect: Literal["gauge_baseline"] = "gauge_baseline"
    delta_mm: float = size(10, 0.05)

    STAGE = "setup"
    KIND_NAME = "distance between the gauges"
    REMEDY = "the gauges stand {e.delta_mm:+z.3f} mm further apart than the rig file says: measure and enter it"
    CORRECTION = OF_THE_GAUGES
    DEED = "check"

    def apply(self, scene: S) -> S:
        """Move each gauge outwards by half of the change. A single gauge has no baseline."""
        offsets_mm = scene.offsets_mm
        if len(offsets_mm) < 2:
            return scene
        return scene.with_gauges_at(offsets_mm + np.sign(offsets_mm - offsets_mm.mean()) * self.delta_mm / 2)

    @classmethod
    def forms(cls, scope: Scope) -> list[list[GaugeBaseline]]:
        return [[cls()]] if len(scope.gauges) > 1 else []
