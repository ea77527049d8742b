"""The work area of a rig, with what a correction leaves there: computed once for the figures and for the entries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from analysis.correction.pose_uncertainty import PoseUncertainty, places_u_mm, pose_uncertainty
from analysis.correction.support import Support
from analysis.correction.work import left_out_mm, rest_effects, used_effects, work_or_spread
from analysis.robot.kinematics.arm import Array
from rigs.effects import Effect
from rigs.rig import Rig


@dataclass(frozen=True, eq=False)
class WorkArea:
    """Postures of the tests of a rig. supported: the effects of the rig file, and how far they are certain."""

    rig: Rig
    supported: Sequence[Support]

    @cached_property
    def q(self) -> Array:
        """Joint angles (n, 6) rad."""
        return work_or_spread(self.rig, self.uncertainty.joints_rad)

    @cached_property
    def uncertainty(self) -> PoseUncertainty:
        return pose_uncertainty(self.rig, self.supported)

    @cached_property
    def used(self) -> tuple[Effect, ...]:
        """Effects that a correction removes."""
        return used_effects(self.rig, self.supported)

    @cached_property
    def uncorrected(self) -> tuple[Effect, ...]:
        """Effects that it leaves."""
        return rest_effects(self.rig, self.supported)

    @cached_property
    def left_out_mm(self) -> Array:
        """RMS error (n, e) mm of each uncorrected effect."""
        return left_out_mm(self.rig, self.uncorrected, self.q)

    @cached_property
    def u_mm(self) -> tuple[Array, Array]:
        """Standard uncertainties (n,) mm of the tool in the robot's base, and in a frame taught at these postures."""
        return places_u_mm(self.rig, self.uncertainty, self.q, self.q)
