"""The robot of an emulated cell: stands, and drives its circle program on command.

Between programs it is set to the start of the next at once; a person would take the link off for that.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Literal

import numpy as np

from analysis.geometry.ball_link import angle
from analysis.geometry.circle import SENSE, frame_of
from analysis.geometry.programs import circle_of, circle_program, radial_stops, repeatability_stops, stops
from analysis.kinematics.arm import Array
from analysis.measures.yaw import plain_figures
from analysis.noise.certificate import as_shown, link_excess_mm
from analysis.simulation.simulate import readings_along
from daq import clock
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.condition import CONDITION, PROGRAM, SAFETY, ProgramState, SafetyState, words_of
from rigs.schema.vocabulary import Direction

_DWELL_S = 1.5
"""The stand at each target; a program for real gauges waits longer."""
_STAND_S = 1.0
"""Standing at the start before it moves, as a program waits for its controller."""


@dataclass(frozen=True)
class Trace:
    """One program run, noise-free. t_s (n,); phi (n,) rad, empty off the circle; q (n, 6) rad reported; g_mm (n, k)."""

    t_s: Array
    phi: Array
    q: Array
    g_mm: Array


def trace(rig: Rig, direction: Direction, test: Literal["yaw", "roll"] = "yaw") -> Trace:
    """The circle of a rig with the effects of its file. Raises FileError where it cannot be driven."""
    program = circle_program(rig, direction)
    return Trace(program.t_s, program.phi, program.q, readings_along(rig, test, program.t_s, program.q))


def target_trace(rig: Rig, test: Literal["radial", "repeatability"]) -> Trace:
    """A program that stops at the targets of the rig's hemisphere. Raises FileError where one is out of reach."""
    t_s, q = stops(radial_stops(rig) if test == "radial" else repeatability_stops(rig), dwell_s=_DWELL_S)
    g_mm = np.repeat(readings_along(rig, test, t_s, q), len(list(rig.gauges)), axis=1) - link_excess_mm(rig)
    return Trace(t_s, np.empty(0), q, g_mm)


PROGRAMS = ("acw", "cw", "roll acw", "roll cw", "radial", "repeatability")
"""acw and cw alone drive the yaw circle. The robot's signal is the number of the program, counted from 1."""


class EmulatedRobot:
    """What its gauges and its controller show at any time; thread-safe."""

    @classmethod
    def of_rig(cls, rig: Rig, seed: int) -> EmulatedRobot:
        """Simulate the programs of both directions, noise-free. Raises FileError where the circle cannot be driven."""
        return cls(rig, {"acw": trace(rig, "acw"), "cw": trace(rig, "cw")}, seed)

    def __init__(self, rig: Rig, traces: dict[Direction, Trace], seed: int) -> None:
        self._rig = rig
        self.traces = traces
        self._gauges = {name: (place, gauge) for place, (name, gauge) in enumerate(rig.gauges)}
        self._further = {name: gauge for name, gauge in rig.gauges.recorded.items() if name not in self._gauges}
        self._random = np.random.default_rng(seed)
        self._lock = threading.Lock()
        self._trace = self.traces["acw"]
        self._start_ns: int | None = None
        self._number = 0
        self._shown: dict[str, float] = {}
        """What a person made it show of its condition."""
        self.finished = clock.Event()
        """Set while it stands."""
        self.finished.set()

    def gauge_mm(self, name: str, now_ns: int) -> float:
        """A reading with noise of the gauge's stated accuracy, and wrong by what its certificate says.

        A gauge that no test measures with touches what stands still: it shows 0, and its noise.
        """
        if further := self._further.get(name):
            with self._lock:
                return float(self._random.normal(0.0, further.accuracy_mm))
        place, gauge = self._gauges[name]
        with self._lock:
            length_mm = self._at(now_ns, self._trace.g_mm[:, place]) + self._random.normal(0.0, gauge.accuracy_mm)
        length_mm *= gauge.sign
        if gauge.certificate is None:
            return float(length_mm)
        return float(as_shown(gauge.certificate, np.asarray(length_mm), self._rig.temperature))

    def joints_deg(self, now_ns: int) -> Sequence[float]:
        """Joint angles as the controller reports them."""
        with self._lock:
            joints: list[float] = np.degrees(self._at(now_ns, self._trace.q)).tolist()
            return joints

    def signal(self, now_ns: int) -> float:
        """Number of the program that runs, 0 for none."""
        with self._lock:
            running = self._start_ns is not None and now_ns < self._start_ns + int(self._trace.t_s[-1] * 1e9)
            return float(self._number if running else 0)

    def condition(self, now_ns: int) -> dict[str, float]:
        """What it shows of its condition, beyond that of a robot that drives undisturbed."""
        program = ProgramState.RUNNING if self.signal(now_ns) else ProgramState.STOPPED
        return {PROGRAM: float(program), **self._shown}

    def show(self, column: str, value: str) -> None:
        """Show this from now on, whatever it drives. Raises FileError for what is no column, or no value of it."""
        states: dict[str, type[IntEnum]] = {PROGRAM: ProgramState, SAFETY: SafetyState}
        if column not in CONDITION:
            raise FileError(repr(column), "is not of the robot's condition", f"give one of {', '.join(CONDITION)}")
        try:
            shown = float(states[column](int(value))) if column in states else float(value)
        except ValueError:
            known = ", ".join(f"{state.value} {words_of(state)}" for state in states.get(column, ()))
            raise FileError(repr(value), f"is no {column}", f"give {known or 'a number'}") from None
        self._shown = {**self._shown, column: shown}

    def start(self, program: str) -> float:
        """Begin a program of `PROGRAMS` now; returns how many seconds it takes.

        Raises FileError for an unknown name, or a program that this rig cannot drive.
        """
        driven = self._driven(program)
        seconds = float(_STAND_S + driven.t_s[-1])
        with self._lock:
            self._trace = driven
            self._number = 1 + PROGRAMS.index(program)
            self._start_ns = clock.now_ns() + int(_STAND_S * 1e9)
            self.finished.clear()
        clock.Thread(target=self._stand_after, args=(seconds,), name="emulated robot", daemon=True).start()
        return seconds

    def _stand_after(self, seconds: float) -> None:
        clock.sleep(seconds)
        self.finished.set()

    def _driven(self, program: str) -> Trace:
        match program:
            case "acw" | "cw":
                return self.traces[program]
            case "roll acw" | "roll cw":
                return trace(self._rig, "acw" if program.endswith(" acw") else "cw", "roll")
            case "radial" | "repeatability":
                return target_trace(self._rig, program)
        raise FileError(repr(program), "is not a program", f"type {', '.join(PROGRAMS)} or quit")

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
        # The first lap: the ways back between laps pass the same angles, with every play on its other side.
        ahead = SENSE[direction] * (trace.phi - start)
        lap = slice(int(np.argmax(ahead >= 0)), int(np.argmax(ahead >= 2 * np.pi)))
        y = angle(trace.g_mm[lap, 0], trace.g_mm[lap, 1], rig.gauges.baseline_mm)
        figures[direction] = plain_figures(trace.phi[lap], y, frame_of(circle_of(rig)).radius)
    planted = {
        "eccentricity_mm": list(circle_of(rig).eccentricity_mm),
        "effects": [effect.model_dump(mode="json") for effect in rig.effects],
    }
    return {"rig": rig.name, "yaw": figures, "planted": planted}
