"""Tolerances of a cell, `limits` of a rig file, and the decision rule for measured figures.

A limit is an upper bound of the size of a figure. The rule is that of ISO 14253-1: the uncertainty counts against the
party making a claim.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from rigs.schema.part import Part

Standing = Literal["pass", "watch", "fail"]
COVERAGE = 2.0
"""Expanded uncertainty U = 2 u, about 95 % (JCGM 100, 6.2), used by ISO 14253-1 to shift a limit."""
TOLERANCE_BY_RP = 5.0
"""Suggested tolerance of an arm relative to the pose repeatability RP (ISO 9283).

RP includes neither backlash nor gear errors, which a circle reveals. An ABB IRB 1600 with a repeatability of 37 µm
drove small circles at 700 mm/s with radial errors of up to 250 µm, and positions were wrong by up to 650 µm (Slamani,
Nubiola and Bonev, Industrial Robot 39, 2012).
"""
USUAL_RP_MM = 0.05
"""RP assumed for an unknown data sheet. Arms of the library have 0.02 to 0.05 mm."""
WATCH_SHARE = 0.5
"""Share of a tolerance above which a figure needs attention: it can still double before it fails."""


class Limit(Part):
    """Bounds of the size of a figure, in the unit of the figure: attention above `watch`, action above `fail`."""

    watch: float | None = Field(default=None, gt=0, le=1e4)
    fail: float | None = Field(default=None, gt=0, le=1e4)

    @model_validator(mode="after")
    def _some_and_ordered(self) -> Limit:
        if self.watch is None and self.fail is None:
            raise ValueError("give watch, fail or both")
        if self.watch is not None and self.fail is not None and self.watch >= self.fail:
            raise ValueError(f"watch {self.watch:g} must be below fail {self.fail:g}; swap them")
        return self

    def standing(self, value: float, u: float) -> Standing:
        """Standing of a figure with standard uncertainty u: pass, watch or fail.

        It passes if |value| + 2 u is within the lower bound, and fails if |value| - 2 u is beyond `fail`. In between,
        or if u is unknown, neither is proven, and the figure needs watching.
        """
        size = abs(value)
        expanded = COVERAGE * u if math.isfinite(u) else math.inf
        if self.fail is not None and size - expanded > self.fail:
            return "fail"
        lower = self.watch if self.watch is not None else self.fail
        return "pass" if lower is not None and size + expanded <= lower else "watch"

    def straddled(self, value: float, u: float) -> bool:
        """True if the uncertainty interval contains a bound: a new measurement may then change the decision."""
        expanded = COVERAGE * u if math.isfinite(u) else math.inf
        return any(abs(abs(value) - bound) < expanded for bound in (self.watch, self.fail) if bound is not None)


def _single(value: Any) -> Any:
    return {"fail": value} if isinstance(value, int | float) and not isinstance(value, bool) else value


Bound = Annotated[Limit | None, BeforeValidator(_single)]


class CircleLimits(Part):
    """Limits of yaw or roll; the hysteresis compares acw with cw."""

    band_deg: Bound = None
    range_deg: Bound = None
    hysteresis_max_deg: Bound = None
    hysteresis_mean_deg: Bound = None
    circular_deviation_mm: Bound = None
    hysteresis_max_mm: Bound = None
    hysteresis_mean_mm: Bound = None
    friction_j1_a: Bound = None
    friction_j2_a: Bound = None
    friction_j3_a: Bound = None
    friction_j4_a: Bound = None
    friction_j5_a: Bound = None
    friction_j6_a: Bound = None


class RadialLimits(Part):
    """Limits of the hemisphere test."""

    band_mm: Bound = None
    held_band_mm: Bound = None
    spread_mm: Bound = None
    spread_mean_mm: Bound = None
    ap_mm: Bound = None
    rp_mm: Bound = None
    rp_mean_mm: Bound = None


class RepeatabilityLimits(Part):
    """Limits of the repeatability test."""

    uni_mm: Bound = None
    uni_mean_mm: Bound = None
    bi_mm: Bound = None
    bi_mean_mm: Bound = None
    rp_mm: Bound = None
    rp_mean_mm: Bound = None
    r_out_mm: Bound = None
    r_in_mm: Bound = None
    r_mm: Bound = None
    reversal_mm: Bound = None
    reversal_mean_mm: Bound = None


class PoseLimits(Part):
    """Limits of tracker poses."""

    rms_mm: Bound = None
    mean_mm: Bound = None
    max_mm: Bound = None
    rms_deg: Bound = None
    max_deg: Bound = None
    repeat_mm: Bound = None
    ap_mm: Bound = None
    ap_mean_mm: Bound = None
    rp_mm: Bound = None
    rp_mean_mm: Bound = None
    ad_mm: Bound = None
    rd_mm: Bound = None


class TouchLimits(Part):
    """Limits of touches."""

    rms_mm: Bound = None
    max_mm: Bound = None
    spat_mm: Bound = None


class PathLimits(Part):
    """Limits of the paths of ISO 9283."""

    line_at_mm: Bound = None
    line_rt_mm: Bound = None
    circle_at_mm: Bound = None
    circle_rt_mm: Bound = None
    small_circle_at_mm: Bound = None
    small_circle_rt_mm: Bound = None
    corner_round_mm: Bound = None
    corner_overshoot_mm: Bound = None
    f_max_mm: Bound = None
    f_min_mm: Bound = None
    d_mm: Bound = None


class Limits(Part):
    """Limits by test and figure (docs/figures.md)."""

    yaw: CircleLimits = CircleLimits()
    roll: CircleLimits = CircleLimits()
    radial: RadialLimits = RadialLimits()
    repeatability: RepeatabilityLimits = RepeatabilityLimits()
    pose: PoseLimits = PoseLimits()
    touch: TouchLimits = TouchLimits()
    path: PathLimits = PathLimits()
    data_sheet_rp_mm: float | None = Field(default=None, gt=0, le=10)
    """Pose repeatability RP (ISO 9283) from the data sheet of the arm, the default limit of each `rp_mm`."""

    def _part(self, test: str) -> Part:
        declared: Part = getattr(self, test, Part())
        return declared

    def of(self, test: str, figure: str) -> Limit | None:
        declared = getattr(self._part(test), figure, None)
        if isinstance(declared, Limit):
            return declared
        return Limit(fail=self.data_sheet_rp_mm) if self.from_data_sheet(test, figure) else None

    def judge(self, test: str) -> bool:
        return self.data_sheet_rp_mm is not None or bool(self._part(test).model_dump(exclude_none=True))

    def from_data_sheet(self, test: str, figure: str) -> bool:
        declared = getattr(self._part(test), figure, None)
        return figure == "rp_mm" and declared is None and self.data_sheet_rp_mm is not None


def offered_tolerance_mm(rp_mm: float | None) -> float:
    """Initial tolerance for an arm with this RP. rp_mm: None if unknown."""
    return float(f"{TOLERANCE_BY_RP * (rp_mm or USUAL_RP_MM):.3g}")


def limits_of_tolerance(tolerance_mm: float, radius_mm: float, rp_mm: float | None) -> Limits:
    """Limits corresponding to an error of `tolerance_mm` at the ball, which turns the link by tolerance / radius.

    Tracker poses have no limit: they cover the work area, in which the error of an arm is larger.
    """
    mm, deg = shared_limit(tolerance_mm), shared_limit(math.degrees(tolerance_mm / radius_mm))
    circle = CircleLimits(band_deg=deg, circular_deviation_mm=mm, hysteresis_max_mm=mm)
    return Limits(
        yaw=circle,
        roll=circle,
        radial=RadialLimits(band_mm=mm),
        repeatability=RepeatabilityLimits(bi_mm=mm),
        data_sheet_rp_mm=rp_mm,
    )


def shared_limit(fail: float) -> Limit:
    return Limit(watch=float(f"{WATCH_SHARE * fail:.3g}"), fail=float(f"{fail:.3g}"))
