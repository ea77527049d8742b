"""Cell of a session: rigd as a process, the operator or emulator who starts the programs, and the recording of a step.

Recording starts when the robot stands at the start of a program and stops when it stands at the end of the path. A run
therefore belongs to the program that was actually driven, which may differ from the requested program.
"""

from __future__ import annotations

import queue
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

from analysis.apps.emulate.served_cell import CellEvent
from analysis.apps.session.child_processes import Child, Talking
from analysis.apps.session.program_watch import ProgramPath, ProgramWatch
from analysis.apps.session.session_plan import SessionProgram
from analysis.apps.session.session_state import Emulated, ProgramStep, Stage
from analysis.procedures.results import why_unusable
from daq import clock
from daq.service.client import Client, find_socket
from daq.store.manifest import DrivenWith
from rigs.errors import CellError, RigError
from rigs.schema.vocabulary import MakerName

POLL_S = 0.1
"""Interval between two checks of the joints."""
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

Say = Callable[[str], None]


class Screen(Protocol):
    """Output of a session."""

    def say(self, line: str) -> None:
        """Print a permanent line."""

    def show(self, line: str) -> None:
        """Replace the progress line."""


class Hands(Protocol):
    """Actions at the cell, by the operator on request or by an emulated cell."""

    def set_up(self, stage: Stage, rig_file: Path) -> Path:
        """Set up a stage and return the rig file of the resulting cell."""

    def start(self, program: SessionProgram) -> None:
        """Start a program, or request it."""

    def go_on(self, program: SessionProgram) -> None:
        """Continue a program that waits for the recording, or request it."""

    def look(self) -> None:
        """Check that the cell is still present. Raises CellError."""

    def enter(self, file: Path) -> bool:
        """Enter the values of a file at the controller; return whether they are entered."""

    def leave(self) -> None:
        """Leave the cell."""


@dataclass(frozen=True)
class ProgramRun:
    """A recorded run.

    name: directory name. program: program that was driven. why: reason for being unusable, or empty. held_up: number of
    stalls of the computer during the run.
    """

    name: str
    program: str
    why: str
    held_up: int = 0


class Driver(Protocol):
    """Drives and records the steps of a session."""

    def set_up(self, stage: Stage, programs: Mapping[str, SessionProgram]) -> None:
        """Prepare a stage and load the programs for it."""

    def drive(self, step: ProgramStep, wait: Callable[[], None]) -> ProgramRun:
        """Drive a step and return the run. `wait` is called repeatedly while waiting. Raises CellError."""

    def enter(self, file: Path) -> bool:
        """Have values entered at the controller; return whether they are entered."""

    def close(self) -> None:
        """Leave the cell as it is."""


class Rigd:
    """Daemon process of a session."""

    @classmethod
    def start(cls, rig_name: str, rig_file: Path, runs: Path, log: Path) -> Rigd:
        """Start the daemon and wait until every stream delivers readings. Raises CellError."""
        _refuse_second_daemon(rig_name)
        rigd = cls(rig_name, Child.start("daq.service.rigd", "rigd", [rig_file, "--runs", runs], log))
        try:
            until_s = clock.now_s() + _READY_S
            while rigd._client is None:
                if not rigd._child.runs:
                    raise rigd._child.ended()
                if clock.now_s() > until_s:
                    raise CellError("rigd", f"was not ready after {_READY_S:.0f} s", f"see {rigd._child.log}")
                clock.sleep(POLL_S)
                with suppress(CellError):
                    rigd._client = Client(find_socket(rigd._name)).__enter__()
            rigd._wait_for_readings()
        except BaseException:
            rigd.stop()
            raise
        return rigd

    def __init__(self, rig_name: str, child: Child) -> None:
        self._name, self._child = rig_name, child
        self._client: Client | None = None
        self._after: dict[str, int] = {}

    def _wait_for_readings(self) -> None:
        """Wait until every stream delivers readings. Raises CellError after the time limit."""
        until_s = clock.now_s() + _READS_S
        while silent := self.silent():
            if clock.now_s() > until_s:
                names = ", ".join(silent)
                raise CellError(
                    names, f"sent no readings for {_READS_S:.0f} s", "run rig doctor, then repeat the command"
                )
            clock.sleep(POLL_S)

    def ask(self, command: str, **fields: Any) -> dict[str, Any]:
        """Send a command to the daemon. Reconnect if the daemon closed an idle connection. Raises RigError."""
        assert self._client is not None  # noqa: S101 - since it came up
        if not self._child.runs:
            raise self._child.ended()
        try:
            return self._client.ask(command, **fields)
        except CellError:  # of the connection; a command refused by rigd raises another RigError
            self._client.__exit__()
            self._client = Client(find_socket(self._name)).__enter__()
            return self._client.ask(command, **fields)

    def silent(self) -> list[str]:
        """Return the streams without a recent reading."""
        streams = self.ask("status")["streams"]
        return [
            name for name, stream in streams.items() if not stream["age_s"] or min(stream["age_s"].values()) > _SILENT_S
        ]

    def joints(self) -> tuple[float, list[float]] | None:
        """Return the time in s and the newest joint angles in degrees; None if unchanged since the last call."""
        robot = self.ask("samples", after=self._after)["streams"].get("robot")
        if not robot or not robot["rows"]:
            return None
        self._after = {"robot": robot["newest"]}
        row, columns = robot["rows"][-1], robot["columns"]
        angles = [row[1 + columns.index(name)] for name in _JOINTS]
        return None if any(angle is None for angle in angles) else (row[0] / 1e9, angles)

    def stop(self) -> None:
        """Stop the daemon. It closes a run in progress."""
        if self._client is not None:
            self._client.__exit__()
        self._child.stop()


StartRigd = Callable[[str, Path, Path, Path], Rigd]
"""Starts the daemon. Arguments: the name of the rig, the rig file, the directory of runs and the log."""


def _refuse_second_daemon(rig_name: str) -> None:
    """Raise CellError if another rigd serves the rig. The daemon of a killed session gets some seconds to exit."""
    until_s = clock.now_s() + _LEAVES_S
    while True:
        try:
            serving = find_socket(rig_name)
        except CellError:
            return
        if clock.now_s() > until_s:
            problem = f"a rigd serves {rig_name} already ({serving}), but a session starts a separate one"
            raise CellError(
                "rigd", problem, "stop the other rigd first; if it is a service: sudo systemctl stop rigd@NAME"
            )
        clock.sleep(POLL_S)


class LiveDriver:
    """Drives steps in a cell and records them with rigd."""

    def __init__(
        self,
        rig_name: str,
        directory: Path,
        hands: Hands,
        screen: Screen,
        operator: str,
        wait_min: float,
        start_rigd: StartRigd = Rigd.start,
    ) -> None:
        """wait_min: minutes to wait for the robot to start a program."""
        self._rig_name, self._directory, self._hands, self._screen = rig_name, directory, hands, screen
        self._operator, self._wait_s, self._start_rigd = operator, 60 * wait_min, start_rigd
        self.entered = False
        """True if the values of a correction are entered at the controller, where they affect every program."""
        self._rigd: Rigd | None = None
        self._programs: Mapping[str, SessionProgram] = {}
        self._ways: dict[str, ProgramPath] = {}
        self._ended = ""
        """Last program completed at this stage."""

    def set_up(self, stage: Stage, programs: Mapping[str, SessionProgram]) -> None:
        """Have the stage set up and start rigd for the resulting cell. Raises CellError."""
        if self._rigd is not None:
            self._rigd.stop()
            self._rigd = None
        self._programs = programs
        self._ways = {name: ProgramPath.of(program.plan) for name, program in programs.items()}
        self._ended = ""
        rig_file = self._hands.set_up(stage, self._directory / "cells" / f"{stage.name}.yaml")
        self._rigd = self._start_rigd(self._rig_name, rig_file, self._directory / "runs", self._directory / "rigd.log")

    def drive(self, step: ProgramStep, wait: Callable[[], None]) -> ProgramRun:
        """Drive and record a step. Raises CellError if no program starts in time."""
        assert self._rigd is not None  # noqa: S101 - a stage was set up
        watch = ProgramWatch(self._ways, step.program, self._ended)
        by: DrivenWith = "entries" if self.entered else ""
        programs = {
            name: replace(program, corrected=program.corrected or by) for name, program in self._programs.items()
        }
        drive = _Drive(self._rigd, self._hands, self._screen, programs, watch, step, wait)
        self._ended = ""
        run = drive.run(self._operator, self._wait_s, self._directory / "runs")
        self._ended = drive.ended
        return run

    def enter(self, file: Path) -> bool:
        """Have values entered at the controller and store the result."""
        self.entered = self._hands.enter(file)
        return self.entered

    def close(self) -> None:
        """Stop rigd and leave the cell."""
        if self._rigd is not None:
            self._rigd.stop()
        self._hands.leave()


@dataclass
class _Drive:
    """Execution of a step, from the request to the run.

    ended: program that has reached its end, or empty. recording: program being recorded, or empty.
    """

    rigd: Rigd
    hands: Hands
    screen: Screen
    programs: Mapping[str, SessionProgram]
    watch: ProgramWatch
    asked: ProgramStep
    wait: Callable[[], None]
    ended: str = ""
    recording: str = ""
    lines: set[str] = field(default_factory=set)
    try_again_s: float = 0.0

    def run(self, operator: str, wait_s: float, runs: Path) -> ProgramRun:
        """Have the step driven. Always stop the recording, even after an error."""
        self.hands.start(self.programs[self.asked.program])
        until_s, look_s = clock.now_s() + wait_s, 0.0
        try:
            while True:
                self.wait()
                self.hands.look()
                if (reading := self.rigd.joints()) is not None:
                    done = self._handle_observation(self.watch.feed(*reading), operator)
                    if done is not None:
                        return self._judged(done, runs)
                now_s = clock.now_s()
                if self.watch.share > 0 or self.watch.stood_s < _MOVES_S:
                    until_s = now_s + wait_s
                if now_s > until_s:
                    if silent := self.rigd.silent():
                        remedy = "see rig doctor; then repeat the command"
                        raise CellError(", ".join(silent), "does not send readings", remedy)
                    where = "waits at the start and was not started" if self.recording else "was not started"
                    raise CellError(self.asked.program, where, "start it, then repeat the command")
                if now_s > look_s:
                    look_s = now_s + _STATUS_S
                    for name in self.rigd.silent():
                        self._tell(f"{name} does not send readings: check the cable; see rig doctor")
                    if not self.recording:
                        self.screen.show(f"  waiting for {self.asked.program}: {(until_s - now_s) / 60:.0f} min left")
                clock.sleep(POLL_S)
        finally:
            if self.recording:
                with suppress(RigError):
                    self.rigd.ask("record_stop")

    def _handle_observation(self, seen: str, operator: str) -> tuple[str, str] | None:
        """React to an observation of the watch.

        Return the completed program and the reason for being unusable, or empty.
        """
        program = self.watch.program
        if seen == "at_start" and not self.recording:
            self._begin(program, operator)
        elif seen == "driving" and not self.recording:
            self._tell(f"{program} started before the recording: wait for the end, then restart it")
        elif seen == "driving":
            self.screen.show(f"  {program}: {100 * self.watch.share:.0f} % of the path, recorded")
        elif seen == "ended" and self.recording:
            self.ended = program
            return program, ""
        elif seen in ("ended", "stopped", "astray") and not self.recording:
            self.watch.reset()
        elif seen == "stopped":
            return program, f"the robot stopped at {100 * self.watch.share:.0f} % of the path"
        elif seen == "astray":
            return program, f"the robot left the path of {program} at {100 * self.watch.share:.0f} % of it"
        elif seen == "elsewhere":
            self._tell(f"the robot drove a path of none of the programs of this stage: start {self.asked.program}")
        return None

    def _begin(self, program: str, operator: str) -> None:
        """Start recording a program and let it continue. Report a refusal and retry later."""
        if clock.now_s() < self.try_again_s:
            return
        driven = self.programs[program]
        if program != self.asked.program:
            self._tell(
                f"this is {program}, not {self.asked.program}: the run is recorded with the label of that program"
            )
        try:
            self.rigd.ask(
                "record_start",
                name=program,
                test=driven.test,
                direction=driven.direction,
                operator=operator,
                placement=driven.stage,
                corrected=driven.corrected,
            )
        except RigError as error:
            self._tell(f"rig does not record: {error}")
            self.try_again_s = clock.now_s() + _AGAIN_S
            return
        self.recording = program
        self.hands.go_on(driven)

    def _judged(self, done: tuple[str, str], runs: Path) -> ProgramRun:
        """Stop the recording and check whether the run is usable."""
        program, why = done
        ended = self.rigd.ask("record_stop")
        self.recording = ""
        name = Path(ended["run"]).name
        why = why or why_unusable(runs / name)
        held_up = ended["counters"].get(_HOST, {}).get("stalled", 0)
        counts = {
            stream: [f"{count} {kind}" for kind, count in counted.items() if kind != "samples"]
            for stream, counted in ended["counters"].items()
        }
        faults = "; ".join(f"{stream}: {', '.join(words)}" for stream, words in counts.items() if words)
        if why and faults:
            why = f"{why} ({faults})"
        return ProgramRun(name, program, why, held_up)

    def _tell(self, line: str) -> None:
        """Print a line unless it was printed before."""
        if line not in self.lines:
            self.lines.add(line)
            self.screen.say(line)


# ----------------------------------------------------------------------------------------------------------------------
# Hands: an operator who receives requests, and an emulated cell that works unattended.


class Person:
    """Operator at the cell. The motion of the robot shows whether a request was followed."""

    def __init__(self, screen: Screen, ask: Callable[[str], bool]) -> None:
        """ask: requests a confirmation from the operator; returns False if the operator cannot answer."""
        self._screen, self._ask = screen, ask

    def set_up(self, stage: Stage, rig_file: Path) -> Path:
        """Return the rig file. The guide has already printed the request."""
        return rig_file

    def start(self, program: SessionProgram) -> None:
        """Ignored: the guide has already printed the request."""

    def go_on(self, program: SessionProgram) -> None:
        self._screen.say(f"{program.name} is being recorded: mount the link, and continue the program")

    def look(self) -> None:
        """Ignored: the operator is always present."""

    def enter(self, file: Path) -> bool:
        return self._ask(f"the values of {file} are entered, and checked as described there")

    def leave(self) -> None:
        """Ignored: the cell stays as it is."""


Hear = Callable[[CellEvent], None]
StartCell = Callable[[Sequence[str | Path], Path, Hear], Talking]
"""Starts an emulated cell. Arguments: the options of `rig emulate`, the log and the listener for events."""


def _emulate(arguments: Sequence[str | Path], log: Path, hear: Hear) -> Child:
    def hear_line(line: str) -> None:
        if event := CellEvent.of_line(line):
            hear(event)

    return Child.start("analysis.cli", "rig emulate", [*arguments, "--json"], log, hear=hear_line)


class EmulatedHands:
    """Emulated cell in a child process. Its robot drives the programs, and its controller accepts entered values."""

    def __init__(
        self,
        directory: Path,
        maker: MakerName,
        emulated: Emulated,
        entered: Sequence[Path],
        start_cell: StartCell = _emulate,
    ) -> None:
        """entered: files with values that are already entered at the controller."""
        self._directory, self._maker, self._emulated = directory, maker, emulated
        self._entered, self._start_cell = list(entered), start_cell
        self._child: Talking | None = None
        self._events: queue.SimpleQueue[CellEvent] = queue.SimpleQueue()
        # A resumed session needs new noise. The same seed would repeat the earlier runs exactly.
        self._visits = len(list((directory / "runs").glob("*")))
        self._waits, self._may_go_on, self._is_busy = False, False, False

    def set_up(self, stage: Stage, rig_file: Path) -> Path:
        """Start the emulated cell of a stage. Raises CellError."""
        self.leave()
        cell = self._directory / "emulated"
        programs = self._directory / "programs" / stage.name
        arguments: list[str | Path] = ["emulate", rig_file, "--programs", programs, "--for", self._maker, "-o", cell]
        if self._emulated.effects:
            arguments += ["--effects", self._emulated.effects]
        self._visits += 1
        self._is_busy = self._waits = False
        arguments += ["--seed", str(self._emulated.seed + self._visits)]
        self._events = queue.SimpleQueue()  # late events of the previous cell are irrelevant
        self._child = self._start_cell(arguments, self._directory / "emulated.log", self._events.put)
        self._await("ready")
        for file in self._entered:
            self._type(f"enter {file}")
            self._await("entered")
        return cell / "rig.yaml"

    def start(self, program: SessionProgram) -> None:
        """Start a program."""
        self._may_go_on = False
        self._free()
        self._type(f"run {program.name}")
        self._is_busy = True

    def go_on(self, program: SessionProgram) -> None:
        """Let the program continue as soon as it waits for the recording."""
        self._may_go_on = True

    def look(self) -> None:
        """Process the events of the cell. Raises CellError if the cell reports an error or has ended."""
        self._hear()
        if self._waits and self._may_go_on:
            self._waits = self._may_go_on = False
            self._type("go on")

    def _hear(self) -> list[str]:
        """Process all new events of the cell and return the kinds.

        Raises CellError if the cell reports an error or has ended.
        """
        assert self._child is not None  # noqa: S101 - a stage was set up
        heard: list[str] = []
        with suppress(queue.Empty):
            while True:
                event = self._events.get_nowait()
                heard.append(event.event)
                match event.event:
                    case "refused" if event.name != "stop":  # a stop typed just after the end of a program is refused
                        raise CellError(
                            "the emulated cell", event.text.removeprefix("error: "), f"see {self._child.log}"
                        )
                    case "waits":
                        self._waits = True
                    case "drives":
                        self._waits = False
                    case "done" | "stopped":
                        self._waits = self._is_busy = False
        if not self._child.runs:
            raise self._child.ended()
        return heard

    def _await(self, event: str) -> None:
        """Wait for an event of the cell. Raises CellError if the cell ends or takes too long."""
        assert self._child is not None  # noqa: S101 - a stage was set up
        until_s = clock.now_s() + _READY_S
        while event not in self._hear():
            if clock.now_s() > until_s:
                raise CellError(self._child.name, f"was not ready after {_READY_S:.0f} s", f"see {self._child.log}")
            clock.sleep(POLL_S)

    def enter(self, file: Path) -> bool:
        """Enter the values of a file at the emulated controller."""
        self._entered.append(file)
        if self._child is not None:
            self._free()
            self._type(f"enter {file}")
            self._await("entered")
        return True

    def _free(self) -> None:
        """Wait for a program at its end, and stop a program that drives or waits.

        The next command would otherwise be queued.
        """
        until_s = clock.now_s() + _END_PAUSE_S
        while self._is_busy and clock.now_s() < until_s:
            self.look()
            clock.sleep(POLL_S)
        if self._is_busy:
            self._type("stop")
            self._is_busy = self._waits = False

    def leave(self) -> None:
        """Switch the cell off."""
        if self._child is not None:
            self._child.stop()
            self._child = None

    def _type(self, line: str) -> None:
        assert self._child is not None  # noqa: S101 - a stage was set up
        self._child.type_line(line)
