"""What a person should do about a missing effect, in one sentence."""

from __future__ import annotations

from typing import Any

from analysis.diagnose.candidates import craig
from rigs.effects import Effect

_AFTERWARDS = {
    "compliance": "joint {axis} gives way under load: enter the payload as it is, or let the controller compensate",
    "link_bending": "the link after joint {axis} bends: enter the payload as it is; look for a loose flange or bolts",
    "reversal_spike": "joint {axis} sticks at reversals: look at brake, seals, grease and the tuning of the servo",
    "wrist_coupling": "motion of joint {from_axis} leaks into joint {to_axis}: correct the wrist's coupling ratio",
    "servo_lag": "joint {axis} comes {lag_ms:.3g} ms late: record encoder angles, not commands, or tune the servo",
    "thermal_growth": "the arm grows as it warms up: run it warm before measuring, or measure quicker",
    "ball_form": "the ball is out of round: turn it by a quarter and measure again; replace it if this turns with it",
    "gauge_scale": "{gauge} reads {percent:+.3g} %: have it calibrated, or enter the scale",
    "gauge_baseline": "the gauges stand {delta_mm:+.3f} mm further apart than the rig file says: measure and enter it",
    "gauge_inclination": "{gauge} stands askew by {angle_deg:.2f}°: shim it",
    "gauge_dead_band": "the plunger of {gauge} sticks by {width_um:.2g} µm: clean and oil it, or replace the gauge",
    "gauge_drift": "{gauge} drifts by {drift_um:+.2g} µm a minute: let it warm up, look at its holder",
    "gauge_cyclic": "{gauge} has an error every {period_mm:g} mm: clean its scale, have its interpolation adjusted",
    "time_lag": "gauge stamps are {lag_ms:+.3g} ms late: enter the delay of the line, or stamp nearer to the gauge",
    "clock_rate": "the clocks run apart by {ppm:+.3g} ppm: synchronise them",
    "vibration": "the link swings at {frequency_hz:.3g} Hz: look for what shakes it, drive slower, stiffen the stand",
}


def remedy(effect: Effect) -> str:
    """In the imperative, with the size where it is to be entered somewhere."""
    of: Any = effect
    match effect.effect:
        case "joint_offset":
            return f"re-master joint {of.axis} by {of.offset_deg:+.4f}° (link = reported + offset), or enter it"
        case "link_geometry":
            unit = "mm" if of.field in ("a", "d") else "°"
            return (
                f"add {of.delta:+.4f} {unit} to {of.field} of axis {of.axis} in the rig file"
                f" ({craig(of.axis, of.field)} in the robot's constants)"
            )
        case "backlash":
            return (
                f"look at the reducer of joint {of.axis}: {of.width_deg:.4f}° of play; approach from one side meanwhile"
            )
        case "transmission_error":
            return (
                f"look at the gear stage of joint {of.axis} that turns {of.order:.4g} times a turn of the joint:"
                f" ± {of.amplitude_deg:.4f}°"
            )
    values = dict(of)
    values["lag_ms"] = 1e3 * values.get("lag_s", 0.0)
    values["percent"] = 1e2 * values.get("relative", 0.0)
    values["width_um"] = 1e3 * values.get("width_mm", 0.0)
    values["drift_um"] = 1e3 * values.get("mm_per_min", 0.0)
    return _AFTERWARDS[effect.effect].format(**values)
