"""The states of the recorder, and what each event makes of them.

Pure: an event in, the next state and what is to be done out. The recorder's threads carry that out and say what came
of it, as events again. Whatever they do, and in whatever order it happens, is decided here. The table of states is
docs/decisions/0016-the-recorder-is-a-state-machine.md.

A *recording* is what a person or the robot asked for; a *run* is a directory. A disk that ends a run does not end the
recording: it waits, and goes on in another run. People come first: the robot ends no recording of a person.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from daq.recording.label import Label
from daq.store.records import Ending

FIRST_PAUSE_S = 5.0
"""So long, since a disk that is full or fails needs somebody."""
REMOVED_PAUSE_S = 0.1
"""After a run whose directory was removed: its disk takes another at once. Not 0, which means a recording's first."""
LONGEST_PAUSE_S = 60.0
MOST_LEAVING = 2
"""With so many runs that were stopped before the disk made them, none is begun: what each has kept is in memory."""


@dataclass(frozen=True)
class Recording:
    """What was asked for, and by whom. since_ns: what came from then on belongs to it, if it is still in memory."""

    label: Label
    by: Literal["person", "robot"] = "person"
    since_ns: int | None = None


@dataclass(frozen=True)
class Idle:
    """Nothing is recorded."""


@dataclass(frozen=True)
class Beginning:
    """The disk is asked for a run. pause_s: how long was waited for it before; 0 if it is the recording's first."""

    recording: Recording
    run: int
    pause_s: float = 0.0


@dataclass(frozen=True)
class Running:
    """A run is written."""

    recording: Recording
    run: int


@dataclass(frozen=True)
class Waiting:
    """The disk ended a run, and another is tried at due_s. closing: that run as long as it is being closed."""

    recording: Recording
    pause_s: float
    due_s: float
    closing: int | None = None


@dataclass(frozen=True)
class Start:
    """A person or the robot asks for a recording."""

    recording: Recording


@dataclass(frozen=True)
class Stop:
    """A person or the robot ends the recording."""

    ending: Ending
    why: str
    by: Literal["person", "robot"] = "person"


@dataclass(frozen=True)
class Created:
    """The disk has made a run."""

    run: int


@dataclass(frozen=True)
class Refused:
    """The disk cannot make a run now."""

    run: int
    now_s: float


@dataclass(frozen=True)
class Failed:
    """The disk is nearly full, or took what came last no more. removed: the run's directory is gone."""

    ending: Ending
    why: str
    now_s: float
    removed: bool = False


@dataclass(frozen=True)
class Closed:
    """A run is closed, well or not."""

    run: int


@dataclass(frozen=True)
class Tick:
    """Time has passed."""

    now_s: float


@dataclass(frozen=True)
class Create:
    """Ask the disk for a run. resumes: it goes on from the run that the disk ended."""

    run: int
    recording: Recording
    resumes: bool = False


@dataclass(frozen=True)
class Close:
    """End a run and close it."""

    run: int
    ending: Ending
    why: str


@dataclass(frozen=True)
class Suspend:
    """Count from now on what comes and is in no run, since this run ended for this reason."""

    run: int
    why: str


@dataclass(frozen=True)
class GiveUp:
    """Forget what was suspended; what it missed is in no run."""


@dataclass(frozen=True)
class Reject:
    """Report why not to the one who asked: another recording runs, too many runs are being made, nothing is
    recorded."""

    why: Literal["running", "making", "idle"]


Phase = Idle | Beginning | Running | Waiting
Event = Start | Stop | Created | Refused | Failed | Closed | Tick
Action = Create | Close | Suspend | GiveUp | Reject
IDLE = Idle()


@dataclass(frozen=True)
class State:
    """leaving: runs that were stopped before the disk made them, each with how it is to end. next: number of a run."""

    phase: Phase = IDLE
    leaving: tuple[Close, ...] = ()
    next: int = 1

    @property
    def recording(self) -> Recording | None:
        """What is being recorded, or is to be; None if nothing is."""
        return None if isinstance(self.phase, Idle) else self.phase.recording

    @property
    def run(self) -> int | None:
        """The run that takes what comes, also while it is being made; None if there is none."""
        return self.phase.run if isinstance(self.phase, Beginning | Running) else None


Outcome = tuple[State, tuple[Action, ...]]


def step(state: State, event: Event) -> Outcome:
    """Return the next state and what is to be done. An event that means nothing in a state changes nothing."""
    match event, state.phase:
        case Start(recording), _:
            return _start(state, recording)
        case Stop(), _:
            mine = state.recording is not None and (event.by == "person" or state.recording.by == "robot")
            if not mine:
                return state, (Reject("idle"),)
            ended, actions = _ended(state, event.ending, event.why)
            return ended, (*actions, Reject("idle")) if isinstance(state.phase, Waiting) else actions
        case ((Created(run) | Refused(run, _)), _) if run != state.run:
            created = isinstance(event, Created)
            closes = tuple(close for close in state.leaving if close.run == run)
            remaining = tuple(close for close in state.leaving if close.run != run)
            return replace(state, leaving=remaining), closes if created else ()
        case Tick(now_s), Waiting(recording, pause_s, due_s, None) if now_s >= due_s:
            return _create(state, recording, pause_s)
    phase, actions = _moved(state.phase, event)
    return replace(state, phase=phase), actions


def _moved(phase: Phase, event: Event) -> tuple[Phase, tuple[Action, ...]]:
    """Return what the disk's answers make of the present recording."""
    match event, phase:
        case Created(), Beginning(recording, run):
            return Running(recording, run), ()
        case Refused(), Beginning(pause_s=0.0):
            return IDLE, ()
        case Refused(_, now_s), Beginning(recording, _, pause_s):
            return Waiting(recording, min(2 * pause_s, LONGEST_PAUSE_S), now_s + pause_s), ()
        case Failed(ending, why, now_s, removed), Running(recording, run):
            pause_s = REMOVED_PAUSE_S if removed else FIRST_PAUSE_S
            waiting = Waiting(recording, pause_s, now_s + pause_s, closing=run)
            return waiting, (Close(run, ending, why), Suspend(run, why))
        case Closed(run), Waiting(closing=closing) if run == closing:
            return replace(phase, closing=None), ()
    return phase, ()


def _start(state: State, recording: Recording) -> Outcome:
    if not _gives_way(state.phase, recording):
        return state, (Reject("running"),)
    if len(state.leaving) >= MOST_LEAVING:
        return state, (Reject("making"),)
    label = recording.label
    ended, actions = _ended(state, "interrupted", f"{label.operator or 'a person'} started {label.name}")
    begun, create = _create(ended, recording)
    return begun, (*actions, *create)


def _gives_way(phase: Phase, to: Recording) -> bool:
    """Return whether a recording may begin: a person's also in place of the robot's, or of one that waits."""
    if isinstance(phase, Idle):
        return True
    resumes = isinstance(phase, Waiting) or (isinstance(phase, Beginning) and phase.pause_s > 0)
    return to.by == "person" and (phase.recording.by == "robot" or resumes)


def _create(state: State, recording: Recording, pause_s: float = 0.0) -> Outcome:
    begun = replace(state, phase=Beginning(recording, state.next, pause_s), next=state.next + 1)
    return begun, (Create(state.next, recording, resumes=pause_s > 0),)


def _ended(state: State, ending: Ending, why: str) -> Outcome:
    """End the present recording, if any; a run that the disk has not made yet ends as soon as it has."""
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
