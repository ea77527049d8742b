"""A simulated circle with twelve effects and so many readings: prints CPU s, and MB of the peak and of the result."""

from __future__ import annotations

import json
import math
import re
import sys
import time
from dataclasses import astuple
from pathlib import Path

import numpy as np

from analysis.procedures.circle import GAUGE_RATE_HZ
from analysis.procedures.simulate import simulate
from rigs.effects import VOCABULARY, Effect
from rigs.load import load
from rigs.rig import Rig

RIG = "ur10e-cell"
TWELVE = (
    {"effect": "time_lag", "lag_s": 0.002},
    {"effect": "link_geometry", "axis": 3, "field": "a", "delta": 0.1},
    {"effect": "backlash", "axis": 1, "width_deg": 0.008, "transit": 0.3},
    {"effect": "transmission_error", "axis": 6, "order": 2, "amplitude_deg": 0.01, "third": 0.1},
    {"effect": "compliance", "axis": 2, "deg_per_Nm": 5e-5, "payload_kg": 5.0},
    {"effect": "reversal_spike", "axis": 3, "amplitude_deg": 0.004},
    {"effect": "joint_offset", "axis": 4, "offset_deg": 0.02},
    {"effect": "link_bending", "axis": 3, "mm_per_Nm": 1e-4},
    {"effect": "thermal_growth", "ppm": 20},
    {"effect": "ball_form", "lobes": 3, "amplitude_mm": 0.001},
    {"effect": "gauge_cyclic", "gauge": "g1", "period_mm": 0.5, "amplitude_mm": 2e-4},
    {"effect": "gauge_dead_band", "gauge": "g2", "width_mm": 5e-4},
)
"""One of each stage and kind: times, the arm, joints with and without history, the tool, the set-up and the gauges."""
LAPS = 50
"""The most that a rig file may ask for: longer runs drive slower."""


def effects() -> list[Effect]:
    """The twelve."""
    return [VOCABULARY[one["effect"]].model_validate(one) for one in TWELVE]


def rig_with(rows: int) -> Rig:
    """A shipped rig whose circle lasts for so many readings: more laps, then slower ones."""
    rig = load(RIG)[0]
    circle = rig.tests.circle
    # A lap and the way back, twice as fast; lead-in and pauses are little beside them.
    round_s = 1.5 * 2 * math.pi * circle.radius_mm / circle.speed_mm_s
    laps = max(1, min(LAPS, round(rows / GAUGE_RATE_HZ / round_s)))
    speed = circle.speed_mm_s * laps * round_s / (rows / GAUGE_RATE_HZ)
    driven = circle.model_copy(update={"laps": laps, "speed_mm_s": speed})
    return rig.model_copy(update={"tests": rig.tests.model_copy(update={"circle": driven})})


def memory_mb(key: str) -> float:
    """Memory of this process now (VmRSS) or at its peak (VmHWM); what getrusage reports begins with the parent's."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    return float(re.findall(rf"{key}:\s*(\d+) kB", status)[0]) * 1.024e-3


def main(rows: int) -> None:
    """Simulates once for the memory and, where this takes no time, more often for the time."""
    hidden = effects()
    simulate(rig_with(1000), "yaw", "acw", 1, hidden)
    before_mb = memory_mb("VmRSS")
    rig, best = rig_with(rows), math.inf
    for _ in range(5 if rows < 500_000 else 2):
        begin = time.process_time()
        table = simulate(rig, "yaw", "acw", 1, hidden)
        best = min(best, time.process_time() - begin)
    peak_mb = memory_mb("VmHWM") - before_mb
    result = sum(part.nbytes for part in astuple(table) if isinstance(part, np.ndarray))
    print(json.dumps({"rows": len(table.t_s), "cpu_s": best, "peak_mb": peak_mb, "result_mb": result / 1e6}))


if __name__ == "__main__":
    main(int(float(sys.argv[1])))
