"""Cell of a session: an operator who starts the programs, or an emulated cell, with rigd as a child process.

A recording lasts from the start to the end of a path. A run therefore belongs to the program that was driven, which may
differ from the requested one.
"""

from __future__ import annotations

import queue
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from analysis.apps.emulate.served_cell import CellEvent
from analysis.apps.report.blocks import Block
from analysis.apps.session.answer import Inference
from analysis.apps.session.child_processes import Child
from analysis.apps.session.correction_step import CORRECTIONS, entries_file
from analysis.apps.session.program_watch import ProgramPath, ProgramWatch
from analysis.apps.session.session_plan import SessionOptions, SessionProgram
from analysis.apps.session.session_state import Emulated, ProgramStep, Session, Stage
from analysis.procedures.results import why_unusable
from daq import clock
from daq.service.client import Client, find_socket
from rigs.errors import CellError, RigError

POLL_S = 0.1
_READY_S = 30.0
"""Time limit for rigd and an emulated cell to start."""
_LEAVES_S = 6.0
"""Time limit for the daemon of a killed session to exit."""
_READS_S = 20.0
"""Time limit for every stream to deliver readings."""
_SILENT_S = 3.0
"""A stream is reported as silent after this time."""
_END_PAUSE_S = 4.0
"""Pause of 3 s at the end of a program, with a margin."""
_STATUS_S = 1.0
_MOVES_S = 0.5
"""Time at rest below which the robot counts as moving, and the session waits for it."""
_AGAIN_S = 1.0
_HOST = "host"
"""Stream of events on the computer, such as stalls."""
_JOINTS = [f"q{axis}_deg" for axis in range(1, 7)]


class Screen(Protocol):
    """Output of a session."""

    def say(self, line: str) -> None:
        """Print a permanent line."""

    def answer(self, blocks: Sequence[Block]) -> None:
        """Print an answer."""

    def show(self, line: str) -> None:
        """Replace the progress line."""


@dataclass(frozen=True)
class ProgramRun:
    name: str
    program: str
    why: str = ""
    held_up: int = 0
    """Number of stalls of the computer during the run."""


def wait_until(done: Callable[[], Any], limit_s: float, error: Callable[[], CellError]) -> None:
    until_s = clock.now_s() + limit_s
    while not done():
        if clock.now_s() > until_s:
            raise error()
        clock.sleep(POLL_S)


def _not_ready(name: str, log: Path) -> CellError:
    return CellError(name, f"was not ready after {_READY_S:.0f} s", f"see {log}", code="process.failed")


def _socket_of(rig_name: str) -> Path | None:
    with suppress(CellError):
        return find_socket(rig_name)
    return None


@dataclass
class RealCell:
    """A cell whose operator reads what to do. The motion of the robot shows what was done."""

    session: Session
    directory: Path
    screen: Screen
    asked: SessionOptions
    entered: list[Path] = field(default_factory=list)
    """Files whose values are entered at the controller, where they affect every program."""
    _programs: Mapping[str, SessionProgram] = field(default_factory=dict)
    _paths: dict[str, ProgramPath] = field(default_factory=dict)
    _ended: str = ""
    """Last program completed at this stage."""
    _recording: str = ""
    """Program being recorded."""
    _try_again_s: float = 0.0
    _lines: set[str] = field(default_factory=set)
    _newest: dict[str, int] = field(default_factory=dict)
    _rigd: Child | None = None
    _client: Client | None = None

    def __post_init__(self) -> None:
        correction = self.session.correction
        if correction and correction.entered:
            self.entered.append(entries_file(self.directory / CORRECTIONS))

    # What the conductor of a session requests.

    def set_up(self, stage: Stage, programs: Mapping[str, SessionProgram]) -> None:
        self.stop_rigd()
        self._programs, self._ended, self._newest = programs, "", {}
        self._paths = {name: ProgramPath.of(program.plan) for name, program in programs.items()}
        self.start_rigd(self.mount(stage, self.directory / "cells" / f"{stage.name}.yaml"))
        wait_until(lambda: not self.silent(), _READS_S, lambda: self._silence(f"sent no readings for {_READS_S:.0f} s"))

    def drive(self, step: ProgramStep, look: Callable[[], None]) -> ProgramRun:
        """Have a step driven, and record it. look: called while waiting. Raises CellError if no program starts."""
        watch = ProgramWatch(self._paths, step.program, self._ended)
        self._ended, self._try_again_s, self._lines = "", 0.0, set()
        self.start_program(self._programs[step.program])
        until_s, status_s = clock.now_s() + 60 * self.asked.wait_min, 0.0
        try:
            while True:
                look()
                self.check()
                reading = self.joints()
                why = None if reading is None else self._handle(watch, watch.feed(*reading), step)
                if why is not None:
                    return self._finish_run(watch.program, why)
                now_s = clock.now_s()
                if watch.share > 0 or watch.stood_s < _MOVES_S:
                    until_s = now_s + 60 * self.asked.wait_min
                if now_s > until_s:
                    raise self._not_started(step)
                if now_s > status_s:
                    status_s = now_s + _STATUS_S
                    for name in self.silent():
                        self._say_once(f"{name} does not send readings: check the cable; see rig doctor")
                    if not self._recording:
                        self.screen.show(f"  waiting for {step.program}: {(until_s - now_s) / 60:.0f} min left")
                clock.sleep(POLL_S)
        finally:
            if self._recording:
                with suppress(RigError):
                    self.ask("record_stop")
                self._recording = ""

    def enter(self, file: Path) -> bool:
        """Have the values of a file entered at the controller; True if they are."""
        if self.is_entered(file):
            self.entered.append(file)
        return file in self.entered

    def infer(self, used: Sequence[Path], judges: Sequence[Path], rig_file: Path, directory: Path) -> Inference:
        return Inference(used, judges, rig_file, directory)

    def close(self) -> None:
        self.stop_rigd()

    # What another kind of cell does in another way.

    def mount(self, stage: Stage, rig_file: Path) -> Path:
        """Set up a stage, and return the rig file of the cell."""
        return rig_file

    def start_program(self, program: SessionProgram) -> None:
        """Start a program. The operator has read the request."""

    def go_on(self, program: SessionProgram) -> None:
        """Let a program continue that waits for the recording."""
        self.screen.say(f"{program.name} is being recorded: mount the link, and continue the program")

    def check(self) -> None:
        """Check that the cell is still present. Raises CellError."""

    def is_entered(self, file: Path) -> bool:
        """Ask whether the values of a file are entered; False without a terminal."""
        if not (sys.stdin is not None and sys.stdin.isatty() and sys.stdout.isatty()):
            return False
        try:
            answer = input(f"the values of {file} are entered, and checked as described there? [y] ")
        except EOFError:
            return False
        return answer.strip().lower() in ("", "y", "yes")

    # rigd.

    def start_rigd(self, rig_file: Path) -> None:
        """Start the daemon, after that of a killed session has exited. Raises CellError."""
        log = self.directory / "rigd.log"
        problem = f"a rigd serves {self.session.rig} already, but a session starts a separate one"
        remedy = "stop the other rigd first; if it is a service: sudo systemctl stop rigd@NAME"
        second = CellError("rigd", problem, remedy, code="daemon.busy")
        wait_until(lambda: not _socket_of(self.session.rig), _LEAVES_S, lambda: second)
        self._rigd = Child.start("daq.service.rigd", "rigd", [rig_file, "--runs", self.directory / "runs"], log)
        wait_until(self._connect, _READY_S, lambda: _not_ready("rigd", log))

    def _connect(self) -> bool:
        """True once the daemon is ready. Raises CellError if it has ended."""
        assert self._rigd is not None  # noqa: S101 - it was started
        if not self._rigd.runs:
            raise self._rigd.ended()
        with suppress(CellError):
            self._client = Client(find_socket(self.session.rig)).__enter__()
        return self._client is not None

    def stop_rigd(self) -> None:
        if self._client is not None:
            self._client.__exit__()
            self._client = None
        if self._rigd is not None:
            self._rigd.stop()
            self._rigd = None

    def ask(self, command: str, **fields: Any) -> dict[str, Any]:
        """Send a command to the daemon; reconnect if it closed an idle connection."""
        assert self._rigd is not None and self._client is not None  # noqa: S101 - a stage was set up
        if not self._rigd.runs:
            raise self._rigd.ended()
        try:
            return self._client.ask(command, **fields)
        except CellError:  # of the connection; a command refused by rigd raises another RigError
            self._client.__exit__()
            self._client = Client(find_socket(self.session.rig)).__enter__()
            return self._client.ask(command, **fields)

    def silent(self) -> list[str]:
        ages_s = {name: stream["age_s"].values() for name, stream in self.ask("status")["streams"].items()}
        return [name for name, ages in ages_s.items() if not ages or min(ages) > _SILENT_S]

    def joints(self) -> tuple[float, list[float]] | None:
        """Time in s and newest joint angles in degrees; None if unchanged since the last call."""
        robot = self.ask("samples", after=self._newest)["streams"].get("robot")
        if not robot or not robot["rows"]:
            return None
        self._newest = {"robot": robot["newest"]}
        row, columns = robot["rows"][-1], robot["columns"]
        angles = [row[1 + columns.index(name)] for name in _JOINTS]
        return None if any(angle is None for angle in angles) else (row[0] / 1e9, angles)

    # Recording of a step.

    def _silence(self, problem: str) -> CellError:
        remedy = "run rig doctor, then repeat the command"
        return CellError(", ".join(self.silent()), problem, remedy, code="robot.silent")

    def _not_started(self, step: ProgramStep) -> CellError:
        if self.silent():
            return self._silence("does not send readings")
        where = "waits at the start and was not started" if self._recording else "was not started"
        return CellError(step.program, where, "start it, then repeat the command", code="robot.refused")

    def _handle(self, watch: ProgramWatch, seen: str, step: ProgramStep) -> str | None:
        """React to an observation: why the run of an ended program is unusable (empty if usable), or None before its
        end.
        """
        program, share = watch.program, f"{100 * watch.share:.0f} %"
        match seen:
            case "elsewhere":
                self._say_once(f"the robot drove a path of none of the programs of this stage: start {step.program}")
            case "at_start" if not self._recording:
                self._begin_run(program, step)
            case "driving" if not self._recording:
                self._say_once(f"{program} started before the recording: wait for the end, then restart it")
            case "ended" | "stopped" | "astray" if not self._recording:
                watch.reset()
            case "driving":
                self.screen.show(f"  {program}: {share} of the path, recorded")
            case "ended":
                self._ended = program
                return ""
            case "stopped":
                return f"the robot stopped at {share} of the path"
            case "astray":
                return f"the robot left the path of {program} at {share} of it"
        return None

    def _begin_run(self, name: str, step: ProgramStep) -> None:
        """Start recording a program and let it continue; retry a refusal later."""
        if clock.now_s() < self._try_again_s:
            return
        program = self._programs[name]
        if name != step.program:
            self._say_once(f"this is {name}, not {step.program}: the run is recorded with the label of that program")
        labels = {
            "test": program.test,
            "direction": program.direction,
            "operator": self.asked.operator,
            "placement": program.stage,
            "corrected": program.corrected or ("entries" if self.entered else ""),
        }
        try:
            self.ask("record_start", name=name, **labels)
        except RigError as error:
            self._say_once(f"rig does not record: {error}")
            self._try_again_s = clock.now_s() + _AGAIN_S
            return
        self._recording = name
        self.go_on(program)

    def _finish_run(self, program: str, why: str) -> ProgramRun:
        ended = self.ask("record_stop")
        self._recording = ""
        name, counters = Path(ended["run"]).name, ended["counters"]
        why = why or why_unusable(self.directory / "runs" / name)
        faults = {
            stream: ", ".join(f"{count} {kind}" for kind, count in counts.items() if kind != "samples")
            for stream, counts in counters.items()
        }
        if why and any(faults.values()):
            why = f"{why} ({'; '.join(f'{stream}: {counts}' for stream, counts in faults.items() if counts)})"
        return ProgramRun(name, program, why, counters.get(_HOST, {}).get("stalled", 0))

    def _say_once(self, line: str) -> None:
        if line not in self._lines:
            self._lines.add(line)
            self.screen.say(line)


class Machine(Protocol):
    """An emulated cell that is switched on (`rig emulate`)."""

    @property
    def runs(self) -> bool: ...

    def type_line(self, line: str) -> None:
        """Type a command of the operator."""

    def ended(self) -> CellError:
        """Error that reports the end of the cell."""

    def stop(self) -> None: ...


@dataclass
class ServedCell(RealCell):
    """A cell emulated by `rig emulate`, whose robot drives the programs and whose controller accepts values."""

    _machine: Machine | None = None
    _events: queue.SimpleQueue[CellEvent] = field(default_factory=queue.SimpleQueue)
    _visits: int = 0
    _is_busy: bool = False
    _waits: bool = False
    _may_go_on: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        # A resumed session needs new noise. The same seed would repeat the earlier runs exactly.
        self._visits = len(list((self.directory / "runs").glob("*")))

    @property
    def emulated(self) -> Emulated:
        assert self.session.emulated is not None  # noqa: S101 - of a session in an emulated cell
        return self.session.emulated

    @property
    def machine(self) -> Machine:
        assert self._machine is not None  # noqa: S101 - a stage was mounted
        return self._machine

    def switch_on(self, rig_file: Path, programs: Path, seed: int, hear: Callable[[CellEvent], None]) -> Machine:
        arguments: list[str | Path] = ["emulate", rig_file, "--programs", programs, "--for", self.session.maker]
        arguments += ["-o", self.directory / "emulated", "--seed", str(seed), "--json"]
        if self.emulated.effects:
            arguments += ["--effects", self.emulated.effects]

        def hear_line(line: str) -> None:
            if event := CellEvent.of_line(line):
                hear(event)

        return Child.start("analysis.cli", "rig emulate", arguments, self.directory / "emulated.log", hear=hear_line)

    # The actions of an operator.

    def mount(self, stage: Stage, rig_file: Path) -> Path:
        self.leave()
        self._visits += 1
        self._is_busy = self._waits = False
        self._events = queue.SimpleQueue()  # late events of the previous cell are irrelevant
        seed = self.emulated.seed + self._visits
        self._machine = self.switch_on(rig_file, self.directory / "programs" / stage.name, seed, self._events.put)
        self._await("ready")
        for file in self.entered:
            self.is_entered(file)
        return self.directory / "emulated" / "rig.yaml"

    def start_program(self, program: SessionProgram) -> None:
        self._may_go_on = False
        self._free()
        self.machine.type_line(f"run {program.name}")
        self._is_busy = True

    def go_on(self, program: SessionProgram) -> None:
        self._may_go_on = True

    def check(self) -> None:
        self._hear()
        if self._waits and self._may_go_on:
            self._waits = self._may_go_on = False
            self.machine.type_line("go on")

    def is_entered(self, file: Path) -> bool:
        if self._machine:
            self._free()
            self._machine.type_line(f"enter {file}")
            self._await("entered")
        return True

    def close(self) -> None:
        super().close()
        self.leave()

    def leave(self) -> None:
        if self._machine:
            self._machine.stop()
            self._machine = None

    def _hear(self) -> list[str]:
        heard: list[str] = []
        while not self._events.empty():
            event = self._events.get()
            heard.append(event.event)
            match event.event:
                case "refused" if event.name != "stop":  # a stop typed just after the end of a program is refused
                    what, log = event.text.removeprefix("error: "), self.directory / "emulated.log"
                    raise CellError("the emulated cell", what, f"see {log}", code="robot.refused")
                case "waits":
                    self._waits = True
                case "drives":
                    self._waits = False
                case "done" | "stopped":
                    self._waits = self._is_busy = False
        if not self.machine.runs:
            raise self.machine.ended()
        return heard

    def _await(self, event: str) -> None:
        log = self.directory / "emulated.log"
        wait_until(lambda: event in self._hear(), _READY_S, lambda: _not_ready("rig emulate", log))

    def _free(self) -> None:
        """Wait for a program at its end; stop one that drives or waits, because it would delay the next command."""
        until_s = clock.now_s() + _END_PAUSE_S
        while self._is_busy and clock.now_s() < until_s:
            self.check()
            clock.sleep(POLL_S)
        if self._is_busy:
            self.machine.type_line("stop")
            self._is_busy = self._waits = False
