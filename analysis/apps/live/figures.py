"""Current figures of a view, for the screen, `--json` and `--plain`."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from analysis.apps.live.lap import ErrorCurve, LiveReversal, motion_sense, speeds
from analysis.apps.live.view import LiveEvent, LiveView
from analysis.robot.geometry.circle import link_angle
from rigs.schema.vocabulary import CIRCLES

OLD_S = 2.0
"""Age from which a reading is marked as old: a frozen number must not look live."""


def angle_deg(view: LiveView, zero_mm: tuple[float, float] = (0.0, 0.0)) -> float | None:
    """Angle between link and tool from the last readings and zeros; None if unavailable."""
    if view.cell is None or not view.cell.has_angle or not {"g1", "g2"} <= view.readings.keys():
        return None
    g1, g2 = (np.array(view.readings[name].mm - zero) for name, zero in zip(("g1", "g2"), zero_mm, strict=True))
    return float(np.degrees(link_angle(g1, g2, view.cell.baseline_mm)))


def angle_name(view: LiveView) -> str:
    return view.test if view.test in CIRCLES else "angle"


def phi_deg(view: LiveView) -> float | None:
    return None if not len(view.phi) or math.isnan(view.phi[-1]) else math.degrees(view.phi[-1])


def lap_share(view: LiveView) -> float | None:
    """Completed share of the current lap; None without motion along the circle."""
    return None if view.cell is None else view.lap.share(view.cell.start_rad, view.cell.lead_rad)


@dataclass(frozen=True)
class LapState:
    place: Literal["no_circle", "off", "stands", "way_back", "lead_in", "lap", "lead_out"]
    number: int = 0
    """Number of the lap, from 1, and its completed share; only of `lap` and `lead_in`."""
    share: float = 0.0


def lap_state(view: LiveView) -> LapState:
    if view.cell is None or view.cell.frame is None:
        return LapState("no_circle")
    if phi_deg(view) is None:
        return LapState("off")
    share, sense = lap_share(view), view.lap.sense
    other_way = view.direction is not None and sense != {"acw": 1, "cw": -1}[view.direction]
    if view.lap.goes_back or (share is not None and other_way):
        return LapState("way_back")
    if share is None:
        return LapState("stands")
    number = 1 + (view.lap.acw if sense > 0 else view.lap.cw) + max(0, math.floor(share))
    if view.direction is not None and number > view.cell.laps:
        return LapState("lead_out")
    return LapState("lead_in", number) if share < 0 else LapState("lap", number, share % 1)


def shown_curves(view: LiveView) -> tuple[ErrorCurve, ErrorCurve]:
    """Error curves acw and cw in degrees, or in mm for a single gauge."""
    per = math.degrees(1.0) if view.cell is not None and view.cell.has_angle else 1.0
    acw, cw = (
        replace(curve, error=curve.error * per, band=curve.band * per) for curve in (view.acw.curve(), view.cw.curve())
    )
    return acw, cw


def figures(view: LiveView) -> dict[str, Any]:
    state, gauges = view.state, {}
    for k, name in enumerate(("g1", "g2")):
        if name in view.readings:
            reading = view.readings[name]
            extremes = np.full(2, np.nan) if view.extremes_mm is None else view.extremes_mm[k]
            low, high = map(_finite_or_none, extremes.tolist())
            gauges[name] = {
                "mm": reading.mm,
                "age_s": round(reading.age_s, 3),
                "min_mm": low,
                "max_mm": high,
                "trend_mm_s": _finite_or_none(float(view.trends_mm_s[k])),
            }
    for name in sorted(view.readings.keys() - gauges.keys()):
        gauges[name] = {"mm": view.readings[name].mm, "age_s": round(view.readings[name].age_s, 3)}
    return {
        "rig": view.cell.name if view.cell else None,
        "lost": view.lost or None,
        "recording": view.name,
        "cut": view.cut or None,
        "test": view.test,
        "direction": view.direction,
        "played_s": view.played.at_s if view.played else None,
        "gauges": gauges,
        "angle_deg": angle_deg(view),
        "phi_deg": phi_deg(view),
        "sense": {1: "acw", -1: "cw", 0: None}[view.lap.sense],
        "lap_share": lap_share(view),
        f"band_{'deg' if view.cell is not None and view.cell.has_angle else 'mm'}": {
            name: _finite_or_none(curve.band) if len(curve.phi) else None
            for name, curve in zip(("acw", "cw"), shown_curves(view), strict=True)
        },
        "joints_deg": [_finite_or_none(float(np.degrees(q))) for q in view.rows.q[-1]] if len(view.rows) else [],
        "joints_sense": [motion_sense(float(speed)) for speed in speeds(view.rows)],
        "reversals": sum(view.reversal_counts),
        "joints_reversals": list(view.reversal_counts),
        "connected": {name: stream["connected"] for name, stream in state["streams"].items()} if state else {},
        "rate_hz": {name: round(stream["rate_hz"], 2) for name, stream in state["streams"].items()} if state else {},
    }


def plain_line(view: LiveView, zero_mm: tuple[float, float] = (0.0, 0.0)) -> str:
    """Current figures for a screen reader or log, relative to the zeros of both gauges in mm."""
    if view.lost:
        return view.lost
    parts = [f"at {view.played.at_s:.1f} s"] if view.played else []
    zeros = dict(zip(("g1", "g2"), zero_mm, strict=True))
    for name, reading in view.readings.items():
        old = f" ({reading.age_s:.0f} s old)" if reading.age_s > OLD_S else ""
        zero = zeros.get(name, 0.0)
        less = f" less {zero:.4f}" if zero else ""
        parts.append(f"{name} {reading.mm - zero:.4f} mm{less}{old}")
    if (degrees := angle_deg(view, zero_mm)) is not None:
        parts.append(f"{angle_name(view)} {degrees:z.4f}°")
    if (phi := phi_deg(view)) is not None:
        share, sense = lap_share(view), {1: " acw", -1: " cw", 0: ""}[view.lap.sense]
        lap = ", way back" if lap_state(view).place == "way_back" else ""
        if share is not None and not lap:
            lap = f", {100 * share:.0f} % of the lap"
        parts.append(f"φ {phi:.1f}°{sense}{lap}")
    parts.append(f"{sum(view.reversal_counts)} reversals")
    if view.state and (lost := [name for name, stream in view.state["streams"].items() if not stream["connected"]]):
        parts.append(f"lost: {', '.join(lost)}")
    if view.name and not view.played:
        parts.append(f"recording {view.name}")
    if view.cut:
        parts.append(view.cut)
    return "; ".join(parts)


def event_words(event: LiveEvent, view: LiveView) -> str:
    if event.reversal is None:
        return event.words
    reversal = event.reversal
    name = f" ({view.cell.axes[reversal.axis - 1]})" if view.cell else ""
    return f"axis {reversal.axis}{name} turned back at {_place(reversal)}"


def _place(reversal: LiveReversal) -> str:
    phi = f"φ {math.degrees(reversal.phi_rad):5.1f}° " if math.isfinite(reversal.phi_rad) else ""
    return f"{phi}{'▲▼' if reversal.upper else '▼▲'}"


def _finite_or_none(value: float) -> float | None:
    return round(float(value), 6) if math.isfinite(value) else None
