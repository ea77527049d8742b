"""What a rig file says that a live view needs: where on the circle the tool is, and what the two gauges show there.

Place and angle come from the functions that `rig analyse` uses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.geometry.circle import CircleFrame, frame_of, link_angle
from analysis.kinematics.arm import Arm, Array, arm_of, forward
from analysis.traces.laps import is_on_circle
from rigs.rig import Rig
from rigs.schema.gauges import Gauge


@dataclass(frozen=True)
class Cell:
    """name: of the rig; axes: names of the joints; baseline_mm: 0 without a second gauge; frame, start_rad, lead_rad,
    laps: of the circle test, frame None where the rig file has none; range_mm: of each gauge by its certificate, None
    where it has none; signs: by which its readings grow with the distance from the ball."""

    name: str
    arm: Arm
    axes: tuple[str, ...]
    baseline_mm: float
    frame: CircleFrame | None
    start_rad: float
    lead_rad: float
    laps: int
    range_mm: tuple[tuple[float, float] | None, ...]
    signs: tuple[int, ...]

    def phi(self, q: Array) -> Array:
        """Circle angle (n,) rad, 0 … 2 pi, of joints q (n, 6) rad; nan where the tool is not on the circle."""
        phi = np.full(len(q), np.nan)
        known_rows = np.isfinite(q).all(axis=1)
        if self.frame is not None and known_rows.any():
            tool = forward(self.arm, q[known_rows])[:, :3, 3]
            phi[known_rows] = np.where(is_on_circle(tool, self.frame), self.frame.angle(tool) % (2 * np.pi), np.nan)
        return phi

    def error_source(self, g_mm: Array) -> Array:
        """What is drawn around the circle, (n,) of readings (n, 2) mm: the angle in rad where there are two gauges,
        else the distance in mm."""
        return link_angle(g_mm[:, 0], g_mm[:, 1], self.baseline_mm) if self.has_angle else g_mm[:, 0]

    @property
    def has_angle(self) -> bool:
        """Whether the rig has the two gauges that an angle needs."""
        return self.baseline_mm != 0


def cell_of(rig: Rig) -> Cell:
    """Return what a rig file says of the cell."""
    circle = rig.tests.circle
    return Cell(
        rig.name,
        arm_of(rig.robot),
        tuple(axis.name for axis in rig.robot.axes),
        rig.gauges.baseline_mm if rig.gauges.g2 else 0.0,
        frame_of(circle) if circle else None,
        float(np.radians(circle.start_deg)) if circle else 0.0,
        float(np.radians(circle.lead_deg)) if circle else 0.0,
        circle.laps if circle else 0,
        tuple(_range_mm(gauge) for _, gauge in rig.gauges),
        tuple(gauge.sign for _, gauge in rig.gauges),
    )


def _range_mm(gauge: Gauge) -> tuple[float, float] | None:
    """The range of a gauge's certificate, in readings that grow with the distance from the ball."""
    if gauge.certificate is None or gauge.certificate.valid_mm is None:
        return None
    low, high = sorted(gauge.sign * end for end in gauge.certificate.valid_mm)
    return low, high
