"""The robot of an emulated cell: stands, and drives its circle program when told to.

Between programs it is set to the start of the next at once; a person would take the link off for that.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.ball_link import angle
from analysis.circle import frame_of
from analysis.kinematics.arm import Array
from analysis.programs import circle_of, circle_program
from analysis.simulate import circle_readings
from analysis.tests.yaw import plain_figures
from rigs.rig import Rig
from rigs.vocabulary import Direction

_STAND_S = 1.0
"""Standing at the start before it moves, as a program waits for its controller."""


@dataclass(frozen=True)
class Trace:
    """One program run, noise-free. t_s (n,); phi (n,) rad; q (n, 6) rad as reported; g_mm (n, 2) as read."""

    t_s: Array
    phi: Array
    q: Array
    g_mm: Array


def trace(rig: Rig, direction: Direction) -> Trace:
    """The yaw circle of a rig with the effects of its file. Raises FileError where it cannot be driven."""
    program = circle_program(rig, direction)
    return Trace(program.t_s, program.phi, program.q, circle_readings(rig, program))


class EmulatedRobot:
    """What its gauges and its controller show at any time; thread-safe."""

    def __init__(self, rig: Rig, seed: int) -> None:
        """Simulates the programs of both directions, noise-free. Raises FileError where the circle cannot be driven."""
        self.traces: dict[Direction, Trace] = {"acw": trace(rig, "acw"), "cw": trace(rig, "cw")}
        self._gauges = {name: (place, gauge.accuracy_mm) for place, (name, gauge) in enumerate(rig.gauges)}
        self._random = np.random.default_rng(seed)
        self._lock = threading.Lock()
        self._trace = self.traces["acw"]
        self._start_ns: int | None = None
        self.finished = threading.Event()
        """Set while it stands."""
        self.finished.set()

    def gauge_mm(self, name: str, now_ns: int) -> float:
        """A reading with noise of the gauge's stated accuracy."""
        place, noise_mm = self._gauges[name]
        with self._lock:
            return float(self._at(now_ns, self._trace.g_mm[:, place]) + self._random.normal(0.0, noise_mm))

    def joints_deg(self, now_ns: int) -> Sequence[float]:
        """Joint angles as the controller reports them."""
        with self._lock:
            joints: list[float] = np.degrees(self._at(now_ns, self._trace.q)).tolist()
            return joints

    def start(self, direction: Direction) -> float:
        """Begin the program of a direction now; returns how many seconds it takes."""
        seconds = float(_STAND_S + self.traces[direction].t_s[-1])
        with self._lock:
            self._trace = self.traces[direction]
            self._start_ns = time.monotonic_ns() + int(_STAND_S * 1e9)
            self.finished.clear()
        end = threading.Timer(seconds, self.finished.set)
        end.daemon = True
        end.start()
        return seconds

    def _at(self, now_ns: int, values: Array) -> Any:
        since_s = -1.0 if self._start_ns is None else (now_ns - self._start_ns) / 1e9
        t_s = self._trace.t_s
        k = int(np.clip(np.searchsorted(t_s, since_s), 1, len(t_s) - 1))
        share = np.clip((since_s - t_s[k - 1]) / (t_s[k] - t_s[k - 1]), 0.0, 1.0)
        row: Any = values[k - 1] + share * (values[k] - values[k - 1])
        return row


def truth(rig: Rig, traces: dict[Direction, Trace]) -> dict[str, Any]:
    """What a perfect measurement of the emulated robot would report, beside what was planted in it.

    The figures follow from the noise-free trace by their definitions; the daemon, the wire and the
    alignment have no part in them. The eccentricity is that of the ball from the circle really driven,
    which backlash moves: it is not quite the planted one.
    """
    start = np.radians(circle_of(rig).start_deg)
    figures = {}
    for direction, trace in traces.items():
        lap = np.abs(np.abs(trace.phi - start) - np.pi) <= np.pi
        lap &= (trace.phi >= start) if direction == "acw" else (trace.phi <= start)
        y = angle(trace.g_mm[lap, 0], trace.g_mm[lap, 1], rig.gauges.baseline_mm)
        figures[direction] = plain_figures(trace.phi[lap], y, frame_of(circle_of(rig)).radius)
    planted = {
        "eccentricity_mm": list(circle_of(rig).eccentricity_mm),
        "effects": [effect.model_dump(mode="json") for effect in rig.effects],
    }
    return {"yaw": figures, "planted": planted}
