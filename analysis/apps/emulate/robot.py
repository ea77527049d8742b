"""Robot of an emulated cell, with motor currents and joint temperatures.

Between programs it jumps to the next start. Friction is lower in a warm joint. The parameters describe no make: they
suit arms of about 20 kg and give a warm-up of some degrees in half an hour.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from pathlib import Path
from typing import Any, Literal

import numpy as np

from analysis.procedures.circle import Yaw, planted_setup
from analysis.procedures.shared.test_kind import nominal_setup, path_of, predict
from analysis.robot.geometry.circle import SENSE, frame_of, link_angle
from analysis.robot.geometry.driven_programs import circle_of, circle_program, radial_stops, repeatability_stops, stops
from analysis.robot.kinematics.arm import Array, arm_of, controller_arm, forward, roll_pitch_yaw, without_setup
from analysis.robot.predict import load_of, model_of, pull
from analysis.runs.noise.certificate import as_shown, link_excess_mm
from analysis.runs.tables import CircleTable, RadialTable
from daq import clock
from daq.store import durable
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.condition import (
    CONDITION,
    CURRENTS,
    POSE,
    PROGRAM,
    SAFETY,
    TEMPERATURES,
    ProgramState,
    SafetyState,
    words_of,
)
from rigs.schema.feedback import condition_columns
from rigs.schema.vocabulary import CIRCLES, CircleTest, Direction, DrivenTest

ROOM_C = 22.0
_TORQUE_NM_A = np.array([12.0, 12.0, 10.0, 8.0, 8.0, 8.0])
"""Joint torque per current: gear ratio times torque constant of the motor."""
COULOMB_NM = np.array([9.0, 9.0, 6.0, 2.4, 2.4, 2.4])
"""Coulomb friction at room temperature."""
_VISCOUS_NMS = np.array([12.0, 12.0, 8.0, 3.0, 3.0, 3.0])
_THINNER_PER_C = 0.008
"""Relative decrease of friction per degree."""
_WARMS_C_A2 = 1.5
"""Final temperature rise per squared current: winding resistance times thermal resistance."""
_WARMING_S = 1500.0
_HOLDS_C = 4.0
"""Temperature rise caused by the joint electronics."""
_CREEP_RAD_S = 1e-4
"""Speed scale of the smooth zero crossing of friction."""


@dataclass
class Motors:
    warm_c: Array = field(default_factory=lambda: np.full(6, ROOM_C + _HOLDS_C))
    """Joint temperatures (6,) at last_ns of the host clock."""
    last_ns: int | None = None

    def currents_and_temperatures(self, now_ns: int, torque_nm: Array, speed_rad_s: Array) -> tuple[Array, Array]:
        """Currents (6,) in A and temperatures (6,) in °C at joint speeds and gravity torques (6,)."""
        friction = COULOMB_NM * np.tanh(speed_rad_s / _CREEP_RAD_S) + _VISCOUS_NMS * speed_rad_s
        friction *= 1 - _THINNER_PER_C * (self.warm_c - ROOM_C)
        current_a = (friction - torque_nm) / _TORQUE_NM_A
        passed_s = 0.0 if self.last_ns is None else max(0.0, (now_ns - self.last_ns) / 1e9)
        self.last_ns = now_ns if self.last_ns is None else max(now_ns, self.last_ns)
        ends_c = ROOM_C + _HOLDS_C + _WARMS_C_A2 * current_a**2
        self.warm_c = ends_c + (self.warm_c - ends_c) * np.exp(-passed_s / _WARMING_S)
        return current_a, self.warm_c


_DWELL_S = 1.5
"""Pause at each target. A program for real gauges waits longer."""
_STANDSTILL_S = 1.0
"""Standstill at the start, where a program waits for the controller."""


_RAMP_S = 0.3
"""Time for stopping on the path and for accelerating again. Chosen."""
_POLL_S = 0.02
State = Literal["drives", "waits", "paused", "stopped", "done"]
"""State of a program. waits: for the operator, as programmed. done, stopped: final states."""


@dataclass(frozen=True)
class Trace:
    """A program run without noise."""

    t_s: Array
    phi: Array
    """Circle angles (n,) in rad; empty off the circle."""
    q: Array
    g_mm: Array
    signals: tuple[tuple[float, float], ...] = ()
    """Start times in s and displayed numbers."""
    holds_s: tuple[float, ...] = ()

    @property
    def end_s(self) -> float:
        """Duration in s, excluding waits for the operator."""
        return float(self.t_s[-1])


@dataclass(frozen=True)
class _Pace:
    """Course of the program time, whose rate changes linearly from `rate` to `wanted`."""

    begin_ns: int
    begin_s: float
    rate: float
    wanted: float

    def at(self, now_ns: int) -> tuple[float, float]:
        since_s = max(0.0, (now_ns - self.begin_ns) / 1e9)
        ramp_s = _RAMP_S * abs(self.wanted - self.rate)
        if since_s >= ramp_s:
            return self.begin_s + (self.rate + self.wanted) / 2 * ramp_s + self.wanted * (since_s - ramp_s), self.wanted
        rate = self.rate + (self.wanted - self.rate) * since_s / ramp_s
        return self.begin_s + (self.rate + rate) / 2 * since_s, rate


def trace(rig: Rig, direction: Direction, test: CircleTest = "yaw") -> Trace:
    program = circle_program(rig, direction)
    return Trace(program.t_s, program.phi, program.q, trace_along(rig, test, program.t_s, program.q))


def target_trace(rig: Rig, test: Literal["radial", "repeatability"]) -> Trace:
    """A program that stops at the targets of the hemisphere. Raises FileError if a target is out of reach."""
    t_s, q = stops(radial_stops(rig) if test == "radial" else repeatability_stops(rig), dwell_s=_DWELL_S)
    return Trace(t_s, np.empty(0), q, trace_along(rig, test, t_s, q))


def trace_along(rig: Rig, test: DrivenTest, t_s: Array, q: Array) -> Array:
    """Gauge readings (n, k) in mm without noise along reported angles q (n, 6) in rad."""
    model = model_of(rig)
    if test in CIRCLES:
        circle = CircleTable(test, "acw", t_s, q, np.empty((0, 2)))
        return predict(model, circle, path_of(model, circle), planted_setup(rig))
    nothing, none = np.zeros(len(q)), np.zeros(len(q), dtype=np.int64)
    targets = RadialTable(none, nothing, nothing, none, t_s, q, nothing)
    g_mm = predict(model, targets, path_of(model, targets), nominal_setup(rig, targets))
    return np.repeat(g_mm, len(list(rig.gauges)), axis=1) - link_excess_mm(rig)


PROGRAMS = ("acw", "cw", "roll acw", "roll cw", "radial", "repeatability")
"""Program names, acw and cw of the yaw circle. The signal of the robot is the number, from 1."""


class EmulatedRobot:
    """Readings of gauges and controller at any time. Thread-safe."""

    @classmethod
    def of_rig(cls, rig: Rig, seed: int) -> EmulatedRobot:
        return cls(rig, {"acw": trace(rig, "acw"), "cw": trace(rig, "cw")}, seed)

    def __init__(self, rig: Rig, traces: dict[Direction, Trace], seed: int) -> None:
        self._rig = rig
        self.traces = traces
        self._gauges = {name: (place, gauge) for place, (name, gauge) in enumerate(rig.gauges)}
        self._further = {name: gauge for name, gauge in rig.gauges.recorded.items() if name not in self._gauges}
        self._random = np.random.default_rng(seed)
        self._lock = threading.Lock()
        self._trace = self.traces["acw"]
        self._pace: _Pace | None = None
        self._holds_s: tuple[float, ...] = ()
        """Times at which the program waits for the operator."""
        self._stopped = False
        self._signal_before = 0.0
        """Signal before the current program switched any output."""
        self._shown: dict[str, float] = {}
        """Condition values set by the operator."""
        self._motors = Motors() if {*CURRENTS, *TEMPERATURES} & {*condition_columns(rig.feedback)} else None
        self._torque_nm: Array | None = None
        """Gravity torques (n, 6) along the trace, computed on first use."""
        self.finished = clock.Event()
        """Set at standstill."""
        self.finished.set()

    def gauge_mm(self, name: str, now_ns: int) -> float:
        """Reading with noise of the specified accuracy and the errors of the certificate.

        A gauge not used by a test touches a fixed object and reads 0 with noise.
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
        with self._lock:
            joints: list[float] = np.degrees(self._at(now_ns, self._trace.q)).tolist()
            return joints

    def signal(self, now_ns: int) -> float:
        """Number of the running program; 0 if none is running, unless a program was stopped early."""
        with self._lock:
            at_s = self._program_s(now_ns)[0]
            shown = [number for since_s, number in self._trace.signals if since_s <= at_s] if self._pace else []
            return shown[-1] if shown else self._signal_before

    def condition(self, now_ns: int) -> dict[str, float]:
        """Values that deviate from the condition of an undisturbed robot."""
        states = {"drives": ProgramState.RUNNING, "waits": ProgramState.PAUSED, "paused": ProgramState.PAUSED}
        state = states.get(self.state(now_ns), ProgramState.STOPPED)
        of_motors = self._of_motors(self._motors, now_ns) if self._motors else {}
        return {PROGRAM: float(state), **of_motors, **self.pose(now_ns), **self._shown}

    def _of_motors(self, motors: Motors, now_ns: int) -> dict[str, float]:
        with self._lock:
            if self._torque_nm is None:
                self._torque_nm = pull(arm_of(self._rig.robot), load_of(self._rig.robot), self._trace.q).torque
            (at_s, rate), t_s, q = self._program_s(now_ns), self._trace.t_s, self._trace.q
            k, speed_rad_s = int(np.searchsorted(t_s, at_s)), np.zeros(q.shape[1])
            if t_s[0] < at_s < self._trace.end_s:
                speed_rad_s = rate * (q[k] - q[k - 1]) / (t_s[k] - t_s[k - 1])
            torque_nm = self._at(now_ns, self._torque_nm)
            current_a, warm_c = motors.currents_and_temperatures(now_ns, torque_nm, speed_rad_s)
        return dict(zip((*CURRENTS, *TEMPERATURES), [*current_a.tolist(), *warm_c.tolist()], strict=True))

    def pose(self, now_ns: int) -> dict[str, float]:
        """Flange pose that the controller computes, if the interface transmits it."""
        if POSE[0] not in condition_columns(self._rig.feedback):
            return {}
        with self._lock:
            T = forward(without_setup(controller_arm(self._rig.robot)), self._at(now_ns, self._trace.q)[None])[0]
        return dict(zip(POSE, [*T[:3, 3].tolist(), *np.degrees(roll_pitch_yaw(T)).tolist()], strict=True))

    def state(self, now_ns: int) -> State:
        with self._lock:
            at_s, rate = self._program_s(now_ns)
            if self._pace is None or (at_s >= self._trace.end_s and not self._holds_s):
                return "done"
            if self._stopped and not rate:
                return "stopped"
            if not self._stopped and not self._pace.wanted:
                return "paused"
            return "waits" if self._holds_s and at_s >= self._holds_s[0] else "drives"

    def show(self, column: str, value: str) -> None:
        """Set a condition value from now on. Raises FileError for an unknown column or invalid value."""
        states: dict[str, type[IntEnum]] = {PROGRAM: ProgramState, SAFETY: SafetyState}
        if column not in CONDITION:
            remedy = f"choose from {', '.join(CONDITION)}"
            raise FileError(repr(column), "is not a condition of the robot", remedy, code="usage")
        try:
            shown = float(states[column](int(value))) if column in states else float(value)
        except ValueError:
            states_in_words = ", ".join(f"{state.value} {words_of(state)}" for state in states.get(column, ()))
            remedy = f"give {states_in_words or 'a number'}"
            raise FileError(repr(value), f"is not a valid {column}", remedy, code="usage") from None
        self._shown = {**self._shown, column: shown}

    def start(self, program: str) -> float:
        """Start a program of `PROGRAMS` and return the duration in seconds.

        Raises FileError for a program that this rig cannot drive.
        """
        match program:
            case "acw" | "cw":
                driven = self.traces[program]
            case "roll acw" | "roll cw":
                driven = trace(self._rig, "acw" if program.endswith(" acw") else "cw", "roll")
            case "radial" | "repeatability":
                driven = target_trace(self._rig, program)
            case _:
                remedy = f"type {', '.join(PROGRAMS)} or quit"
                raise FileError(repr(program), "is not a program", remedy, code="maker.unknown")
        number = float(1 + PROGRAMS.index(program))
        return self.play(replace(driven, signals=((-_STANDSTILL_S, number), (driven.end_s, 0.0))))

    def play(self, trace: Trace) -> float:
        """Start a trace and return the duration in seconds, excluding waits for the operator."""
        now_ns = clock.now_ns()
        before = self.signal(now_ns)
        with self._lock:
            self._trace, self._signal_before, self._stopped, self._torque_nm = trace, before, False, None
            self._holds_s = tuple(sorted(trace.holds_s))
            self._pace = _Pace(now_ns + int(_STANDSTILL_S * 1e9), 0.0, 1.0, 1.0)
        self.finished.clear()
        clock.Thread(target=self._watch, name="emulated program", daemon=True).start()
        return _STANDSTILL_S + trace.end_s

    def stop(self) -> bool:
        """Stop on the path; outputs do not change. False if no program was running."""
        return self._at_rate(0.0, ("drives", "waits", "paused"), stops=True)

    def pause(self) -> bool:
        return self._at_rate(0.0, ("drives",))

    def go_on(self) -> bool:
        now_ns = clock.now_ns()
        if self.state(now_ns) != "waits":
            return self._at_rate(1.0, ("paused",))
        with self._lock:
            self._pace = _Pace(now_ns, self._holds_s[0], 1.0, 1.0)
            self._holds_s = self._holds_s[1:]
        return True

    def reads_more(self, more_rad: Array) -> None:
        """Change the joint readings (6,) at rest, in rad: a zero was entered at the controller."""
        with self._lock:
            self._trace = replace(self._trace, q=self._trace.q + more_rad)

    def _at_rate(self, new_rate: float, states: Sequence[State], *, stops: bool = False) -> bool:
        now_ns = clock.now_ns()
        state = self.state(now_ns)
        if state not in states:
            return False
        with self._lock:
            at_s, rate = self._program_s(now_ns)
            self._pace = _Pace(now_ns, at_s, 0.0 if state == "waits" else rate, new_rate)
            self._stopped = stops
        return True

    def _watch(self) -> None:
        while self.state(clock.now_ns()) not in ("done", "stopped"):
            clock.sleep(_POLL_S)
        self.finished.set()

    def _program_s(self, now_ns: int) -> tuple[float, float]:
        """Program time in s and the current rate. The caller must hold the lock."""
        if self._pace is None:
            return -_STANDSTILL_S, 0.0
        at_s, rate = self._pace.at(now_ns)
        until_s = min([self._trace.end_s, *self._holds_s[:1]])
        return min(at_s, until_s), rate

    def _at(self, now_ns: int, values: Array) -> Any:
        since_s, t_s = self._program_s(now_ns)[0], self._trace.t_s
        k = int(np.clip(np.searchsorted(t_s, since_s), 1, len(t_s) - 1))
        share = np.clip((since_s - t_s[k - 1]) / (t_s[k] - t_s[k - 1]), 0.0, 1.0)
        row: Any = values[k - 1] + share * (values[k] - values[k - 1])
        return row


def ideal_results(rig: Rig, traces: dict[Direction, Trace]) -> dict[str, Any]:
    """Results of an ideal measurement, and the hidden errors. Backlash shifts the circle and so the eccentricity
    slightly."""
    start = np.radians(circle_of(rig).start_deg)
    figures = {}
    for direction, trace in traces.items():
        # Only the first lap: a return passes the same angles on the opposite side of the backlash.
        ahead = SENSE[direction] * (trace.phi - start)
        lap = slice(int(np.argmax(ahead >= 0)), int(np.argmax(ahead >= 2 * np.pi)))
        y = link_angle(trace.g_mm[lap, 0], trace.g_mm[lap, 1], rig.gauges.baseline_mm)
        figures[direction] = Yaw().plain_figures(trace.phi[lap], y, frame_of(circle_of(rig)).radius)
    planted = {
        "eccentricity_mm": list(circle_of(rig).eccentricity_mm),
        "effects": [effect.model_dump(mode="json") for effect in rig.effects],
    }
    return {"rig": rig.name, "yaw": figures, "planted": planted}


RIG, TRUTH = "rig.yaml", "truth.json"
"""Files of an emulated cell: the rig file and the ideal results."""


def write_cell_files(directory: Path, rig: Rig, robot: EmulatedRobot, text: str) -> Path:
    """Write the files of an emulated cell, replacing earlier ones, and return the rig file. text: of that file."""
    path = directory / RIG
    try:
        directory.mkdir(parents=True, exist_ok=True)
        durable.replace(directory / TRUTH, (json.dumps(ideal_results(rig, robot.traces), indent=2) + "\n").encode())
        for name, content in rig.companion_files.items():
            durable.replace(directory / name, content)
        durable.replace(path, text.encode())  # last, because the other files identify an emulated cell
    except OSError as error:
        raise FileError.of_os(directory, error, "choose a different --output", code="output.not_writable") from None
    return path
