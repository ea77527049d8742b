"""State machine of the recorder, pure (docs/decisions/0016-the-recorder-is-a-state-machine.md has the table of states).

A *recording* is a request by the operator or the robot; a *run* is a directory. A disk failure ends the run, but not
the recording, which waits and continues in a new run. The robot cannot end the operator's recording.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from daq.recording.active_run import RunLabel
from daq.store.ledger import Ending

FIRST_PAUSE_S = 5.0
"""First pause after a disk failure. The operator must attend to a full or failing disk."""
REMOVED_PAUSE_S = 0.1
"""Pause after a run directory was removed. The disk can take a new run immediately; zero means a first run."""
LONGEST_PAUSE_S = 60.0
MOST_LEAVING = 2
"""Stopped runs that have no directory yet. Their samples are in memory."""


@dataclass(frozen=True)
class RecordingRequest:
    """A request. since_ns: buffered samples from this time on belong to the recording."""

    label: RunLabel
    by: Literal["person", "robot"] = "person"
    since_ns: int | None = None


@dataclass(frozen=True)
class Idle:
    """No recording."""


@dataclass(frozen=True)
class Beginning:
    """The run is being created. pause_s: pause before this attempt, 0 for the first run of a recording."""

    recording: RecordingRequest
    run: int
    pause_s: float = 0.0


@dataclass(frozen=True)
class Running:
    """The run is being written."""

    recording: RecordingRequest
    run: int


@dataclass(frozen=True)
class Waiting:
    """The disk ended a run; the next attempt is at due_s. closing: the old run while it is being closed."""

    recording: RecordingRequest
    pause_s: float
    due_s: float
    closing: int | None = None


@dataclass(frozen=True)
class StartRequested:
    """The operator or the robot requests a recording."""

    recording: RecordingRequest


@dataclass(frozen=True)
class StopRequested:
    """The operator or the robot ends the recording."""

    ending: Ending
    why: str
    by: Literal["person", "robot"] = "person"


@dataclass(frozen=True)
class Created:
    """The disk has created the run."""

    run: int


@dataclass(frozen=True)
class RunRefused:
    """The disk cannot create a run now."""

    run: int
    now_s: float


@dataclass(frozen=True)
class DiskFailed:
    """The disk is nearly full or refused a write. removed: the run directory is gone."""

    ending: Ending
    why: str
    now_s: float
    removed: bool = False


@dataclass(frozen=True)
class Closed:
    """A run was closed, successfully or not."""

    run: int


@dataclass(frozen=True)
class Tick:
    """Time has passed."""

    now_s: float


@dataclass(frozen=True)
class Create:
    """Create a run. resumes: True if the run continues one that the disk ended."""

    run: int
    recording: RecordingRequest
    resumes: bool = False


@dataclass(frozen=True)
class Close:
    """End and close a run."""

    run: int
    ending: Ending
    why: str


@dataclass(frozen=True)
class Suspend:
    """Count samples as missed from now on. why: reason for the end of the run."""

    run: int
    why: str


@dataclass(frozen=True)
class GiveUp:
    """Abandon the suspended recording and its missed samples."""


@dataclass(frozen=True)
class Reject:
    """Reject the request: already recording, too many pending runs, or not recording."""

    why: Literal["running", "making", "idle"]


Phase = Idle | Beginning | Running | Waiting
Event = StartRequested | StopRequested | Created | RunRefused | DiskFailed | Closed | Tick
Action = Create | Close | Suspend | GiveUp | Reject
IDLE = Idle()


@dataclass(frozen=True)
class RecorderState:
    phase: Phase = IDLE
    leaving: tuple[Close, ...] = ()
    """Stopped runs that the disk has not created, each with its ending."""
    next: int = 1

    @property
    def recording(self) -> RecordingRequest | None:
        return None if isinstance(self.phase, Idle) else self.phase.recording

    @property
    def run(self) -> int | None:
        """Run that receives samples, even before its directory exists; None if idle."""
        return self.phase.run if isinstance(self.phase, Beginning | Running) else None


Outcome = tuple[RecorderState, tuple[Action, ...]]


def step(state: RecorderState, event: Event) -> Outcome:
    match event, state.phase:
        case StartRequested(recording), _:
            return _start(state, recording)
        case StopRequested(), _:
            mine = state.recording is not None and (event.by == "person" or state.recording.by == "robot")
            if not mine:
                return state, (Reject("idle"),)
            ended, actions = _ended(state, event.ending, event.why)
            return ended, (*actions, Reject("idle")) if isinstance(state.phase, Waiting) else actions
        case ((Created(run) | RunRefused(run, _)), _) if run != state.run:
            created = isinstance(event, Created)
            closes = tuple(close for close in state.leaving if close.run == run)
            remaining = tuple(close for close in state.leaving if close.run != run)
            return replace(state, leaving=remaining), closes if created else ()
        case Tick(now_s), Waiting(recording, pause_s, due_s, None) if now_s >= due_s:
            return _create(state, recording, pause_s)
    phase, actions = _moved(state.phase, event)
    return replace(state, phase=phase), actions


def _moved(phase: Phase, event: Event) -> tuple[Phase, tuple[Action, ...]]:
    match event, phase:
        case Created(), Beginning(recording, run):
            return Running(recording, run), ()
        case RunRefused(), Beginning(pause_s=0.0):
            return IDLE, ()
        case RunRefused(_, now_s), Beginning(recording, _, pause_s):
            return Waiting(recording, min(2 * pause_s, LONGEST_PAUSE_S), now_s + pause_s), ()
        case DiskFailed(ending, why, now_s, removed), Running(recording, run):
            pause_s = REMOVED_PAUSE_S if removed else FIRST_PAUSE_S
            waiting = Waiting(recording, pause_s, now_s + pause_s, closing=run)
            return waiting, (Close(run, ending, why), Suspend(run, why))
        case Closed(run), Waiting(closing=closing) if run == closing:
            return replace(phase, closing=None), ()
    return phase, ()


def _start(state: RecorderState, recording: RecordingRequest) -> Outcome:
    """The operator may replace a recording of the robot, or one that waits for the disk."""
    phase, by_person = state.phase, recording.by == "person"
    resumes = isinstance(phase, Waiting) or (isinstance(phase, Beginning) and phase.pause_s > 0)
    if not isinstance(phase, Idle) and not (by_person and (phase.recording.by == "robot" or resumes)):
        return state, (Reject("running"),)
    if len(state.leaving) >= MOST_LEAVING:
        return state, (Reject("making"),)
    label = recording.label
    ended, actions = _ended(state, "interrupted", f"{label.operator or 'a person'} started {label.name}")
    begun, create = _create(ended, recording)
    return begun, (*actions, *create)


def _create(state: RecorderState, recording: RecordingRequest, pause_s: float = 0.0) -> Outcome:
    begun = replace(state, phase=Beginning(recording, state.next, pause_s), next=state.next + 1)
    return begun, (Create(state.next, recording, resumes=pause_s > 0),)


def _ended(state: RecorderState, ending: Ending, why: str) -> Outcome:
    idle = replace(state, phase=IDLE)
    match state.phase:
        case Beginning(_, run):
            return replace(idle, leaving=(*state.leaving, Close(run, ending, why))), ()
        case Running(_, run):
            return idle, (Close(run, ending, why),)
        case Waiting():
            return idle, (GiveUp(),)
        case Idle():
            return idle, ()
