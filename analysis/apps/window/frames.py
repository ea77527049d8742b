"""Data of the live cell and the session for pages, by kind. Curves are integers of the last digit: half the size."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from analysis.apps.live.figures import OLD_S, angle_deg, angle_name, event_words, figures, lap_state, shown_curves
from analysis.apps.live.lap import ErrorCurve, pieces
from analysis.apps.live.view import LiveView
from analysis.apps.report.page.accuracy import now_sentence
from analysis.apps.report.texts import texts_of
from analysis.apps.session.next_step import Drive, Infer, next_of
from analysis.apps.session.session_answer import before_after
from analysis.apps.session.session_state import Session
from analysis.robot.kinematics.arm import Array

TRACE_S = 30.0
_TRACE_POINTS = 240
_CURVE_POINTS = 360
_EVENTS = 12
_REVERSALS = 24
"""Joint reversals marked on the circle, from about two laps."""
_ONE_PLACE_DEG = 5.0
_SCALES = (1.0, 2.0, 5.0)
_SMALLEST = 1e-4
"""Smallest scale, in degrees or mm: the resolution of a gauge."""
_PHI_PER_DEG, _ERROR_PER_UNIT, _UM_TENTHS_PER_MM = 10, 1e5, 1e4


def cell(view: LiveView) -> dict[str, Any]:
    if view.cell is None:
        return {}
    return {
        "name": view.cell.name,
        "axes": list(view.cell.axes),
        "unit": "°" if view.cell.has_angle else "mm",
        "circle": view.cell.frame is not None,
        "start_deg": math.degrees(view.cell.start_rad),
        "laps": view.cell.laps,
        "range_mm": [list(range_mm) if range_mm else None for range_mm in view.cell.range_mm],
    }


def now(view: LiveView, zero_mm: tuple[float, float], tick: int) -> dict[str, Any]:
    """Current figures relative to the zeros of both gauges. tick: makes each frame unique."""
    lap, state = lap_state(view), view.state or {}
    return {
        **figures(view),
        "tick": tick,
        "at_s": float(view.rows.t_s[-1]) if len(view.rows) else None,
        "zero_mm": list(zero_mm) if any(zero_mm) else None,
        "angle_deg": angle_deg(view, zero_mm),
        "angle_name": angle_name(view),
        "lap": {"place": lap.place, "number": lap.number, "share": round(lap.share, 4)},
        "seconds": state.get("seconds") if view.name else None,
        "old_s": OLD_S,
    }


def curve(error_curve: ErrorCurve) -> dict[str, Any]:
    """Pieces of a curve: angles in tenths of a degree, errors in hundred-thousandths of the unit."""
    step = max(1, math.ceil(len(error_curve.phi) / _CURVE_POINTS))
    return {
        "band": round(error_curve.band, 6) if len(error_curve.phi) else None,
        "whole": error_curve.is_full_lap,
        "less_sine": error_curve.less_sine,
        "pieces": [
            [
                _rounded(np.degrees(error_curve.phi[piece])[::step] * _PHI_PER_DEG),
                _rounded(error_curve.error[piece][::step] * _ERROR_PER_UNIT),
            ]
            for piece in pieces(error_curve)
        ],
    }


def curves(view: LiveView) -> dict[str, dict[str, Any]]:
    both = shown_curves(view)
    turned: list[list[float]] = []
    for reversal in reversed(view.reversals[-_REVERSALS:]):
        if not math.isfinite(reversal.phi_rad):
            continue
        phi_deg = round(math.degrees(reversal.phi_rad), 1)
        # Mark a joint that reverses at the same position in two laps only once.
        is_marked = any(
            (axis, sense) == (reversal.axis, reversal.sense)
            and abs(math.remainder(phi_deg - at_deg, 360.0)) < _ONE_PLACE_DEG
            for axis, at_deg, sense in turned
        )
        if not is_marked:
            turned.append([reversal.axis, phi_deg, reversal.sense])
    return {"acw": curve(both[0]), "cw": curve(both[1]), "circle": {"scale": _scale_of(both), "turned": turned}}


def _scale_of(curves: tuple[ErrorCurve, ErrorCurve]) -> float:
    """Error at full scale: 1, 2 or 5 times a power of ten, above the largest error."""
    largest = max((float(np.abs(curve.error).max()) for curve in curves if len(curve.error)), default=0.0)
    power = 10.0 ** math.floor(math.log10(max(largest, _SMALLEST)))
    return next(scale * power for scale in (*_SCALES, 10.0) if scale * power >= largest)


def trace(view: LiveView) -> dict[str, Any]:
    """Readings of the last seconds: ages in hundredths of a second, deviations from the mean in tenths of a µm."""
    recent = view.since(TRACE_S)
    recent = recent.select_rows(slice(None, None, max(1, math.ceil(len(recent) / _TRACE_POINTS))))
    if not len(recent):
        return {"t": [], "g": [[], []]}
    lines: list[list[int | None]] = [[], []]
    for line, mm in zip(lines, recent.g_mm.T, strict=True):
        finite = np.isfinite(mm)
        if finite.any():
            tenths = np.where(finite, mm - mm[finite].mean(), 0.0) * _UM_TENTHS_PER_MM
            values = zip(tenths.tolist(), finite.tolist(), strict=True)
            line.extend(round(value) if is_finite else None for value, is_finite in values)
    return {"t": _rounded((recent.t_s - recent.t_s[-1]) * 100), "g": lines}


def links(view: LiveView) -> dict[str, Any]:
    state = view.state or {}
    streams = [
        {
            "name": name,
            "connected": stream["connected"],
            "rate_hz": round(stream["rate_hz"], 1),
            "faults": ", ".join(f"{count} {kind}" for kind, count in stream["counters"].items() if kind != "samples"),
            "last_fault": stream["last_fault"],
        }
        for name, stream in state.get("streams", {}).items()
    ]
    disk = state.get("disk")
    return {
        "streams": streams,
        "disk": {"free": disk["free_bytes"], "size": disk["size_bytes"]} if disk else None,
        "last_end": state.get("last_end") or "",
        "events": [[round(event.t_s, 1), event_words(event, view)] for event in reversed(view.events[-_EVENTS:])],
    }


def _rounded(values: Array) -> list[int]:
    whole_numbers: list[int] = np.rint(values).astype(int).tolist()
    return whole_numbers


def summary(session: Session) -> dict[str, Any]:
    answer, correction, after = session.answer, session.correction, before_after(session, Path())
    now = now_sentence(after, texts_of("en")) if after else ""
    return {
        "rig": session.rig,
        "began": session.began,
        "next": _next(session),
        "steps": [
            {
                "program": step.program,
                "state": "driven" if step.run else "skipped" if step.skipped else "again" if step.tries else "open",
                "run": step.run or "",
                "why": step.skipped or (step.tries[-1].why if step.tries and not step.run else ""),
            }
            for step in session.steps
        ],
        "summary": shown_summary(session),
        "headline": answer.headline if answer else "",
        "accuracy": (session.judged or answer).accuracy if answer and not session.is_corrected else "",
        "runs": answer.runs if answer else 0,
        "parts": [
            {"part": f"{part.part} {part.size}".strip(), "share": part.share, "um": part.um, "fault": part.fault}
            for part in (answer.parts if answer else ())
        ],
        "remedies": list(session.to_do),
        "correction": now or (correction.sentence if correction else ""),
        "before_after": [
            {
                "where": side.place,
                "before": side.before.model_dump(exclude={"runs"}),
                "after": side.after.model_dump(exclude={"runs"}) if side.after else None,
                "expected": side.expected.model_dump() if side.expected else None,
            }
            for side in session.sides
        ],
        "work": correction.work.model_dump() if correction and correction.work else None,
        "report": session.report,
    }


def shown_summary(session: Session) -> dict[str, Any] | None:
    if (summary := session.summary) is None:
        return None
    error = summary.error
    shown = {"title": error.title, "size": error.words, "basis": f"{error.basis} {error.standing}".rstrip()}
    return asdict(summary) | {"error": shown}


def _next(session: Session) -> dict[str, Any]:
    match following := next_of(session):
        case Drive(number):
            step = session.steps[number]
            place = {"number": number + 1, "of": len(session.steps), "stage": session.stage_of(step).words}
            return {"key": "drive", "program": step.program} | place
        case Infer():
            return {"key": "infer"}
    return {"key": following}
