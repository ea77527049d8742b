from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import pytest

from daq.recording.active_run import RunLabel
from daq.recording.machine import (
    FIRST_PAUSE_S,
    LONGEST_PAUSE_S,
    MOST_LEAVING,
    Action,
    Beginning,
    Close,
    Closed,
    Create,
    Created,
    DiskFailed,
    Event,
    GiveUp,
    Idle,
    RecorderState,
    RecordingRequest,
    Reject,
    Running,
    RunRefused,
    StartRequested,
    StopRequested,
    Suspend,
    Tick,
    Waiting,
    step,
)

LONG_S = 1e9
MINE = RecordingRequest(RunLabel(name="mine", test="radial"))
THEIRS = RecordingRequest(RunLabel(name="theirs", test="yaw", direction="cw", operator="automatic"), "robot")
ENOUGH, STANDS = StopRequested("complete", "enough"), StopRequested("complete", "the robot stands still", "robot")
FULL = DiskFailed("interrupted", "disk nearly full", 0.0)


@dataclass(frozen=True)
class World:
    """Requests to the disk, its answers, and the gap of a suspended run.

    asked: requested runs without an answer; made, closing: created runs, and runs being closed. gap: "none", "waiting"
    for
    a run, or the number of the run that will end it.
    """

    asked: frozenset[int] = frozenset()
    made: frozenset[int] = frozenset()
    closing: frozenset[int] = frozenset()
    gap: int | Literal["none", "waiting"] = "none"


Point = tuple[RecorderState, World]


def events(world: World) -> Iterator[Event]:
    """Yield all possible events; from the disk only answers to requests."""
    yield from (StartRequested(MINE), StartRequested(THEIRS), ENOUGH, STANDS, FULL, Tick(0.0), Tick(LONG_S))
    for run in sorted(world.asked):
        yield from (Created(run), RunRefused(run, 0.0))
    yield from map(Closed, sorted(world.closing))


def follow(point: Point, event: Event) -> Point:
    before, world = point
    after, actions = step(before, event)
    world = _carried_out(_happened(world, event, after), actions)
    _require_order(after, world)
    _require_people_first(before, event, after, actions)
    return after, world


def _happened(world: World, event: Event, after: RecorderState) -> World:
    match event:
        case Created(run):
            gap = "none" if world.gap == run else world.gap
            return replace(world, asked=world.asked - {run}, made=world.made | {run}, gap=gap)
        case RunRefused(run, _):
            waits = "waiting" if isinstance(after.phase, Waiting) else "none"
            return replace(world, asked=world.asked - {run}, gap=waits if world.gap == run else world.gap)
        case Closed(run):
            return replace(world, closing=world.closing - {run})
    return world


def _carried_out(world: World, actions: tuple[Action, ...]) -> World:
    for action in actions:
        match action:
            case Create(run, _, resumes):
                assert run not in world.asked | world.made  # a run is asked for once
                assert not resumes or world.gap == "waiting"
                world = replace(world, asked=world.asked | {run}, gap=run if resumes else world.gap)
            case Close(run):
                assert run in world.made  # what is closed was made, and is closed once
                world = replace(world, made=world.made - {run}, closing=world.closing | {run})
            case Suspend(run):
                assert world.gap != "waiting" and run in world.closing
                world = replace(world, gap="waiting")
            case GiveUp():
                assert world.gap == "waiting"
                world = replace(world, gap="none")
    return world


def _require_order(state: RecorderState, world: World) -> None:
    """Check that every run on the disk is known to the recorder, and that only one run receives new samples."""
    leaving = {close.run for close in state.leaving}
    beginning = {state.phase.run} if isinstance(state.phase, Beginning) else set()
    assert world.asked == leaving | beginning  # each run that the disk makes is known
    assert world.made == ({state.phase.run} if isinstance(state.phase, Running) else set())  # one is written at most
    assert (world.gap == "waiting") == isinstance(state.phase, Waiting)  # what is missed is counted while one waits
    assert len(leaving) <= MOST_LEAVING + 1  # what is in memory is bounded


def _require_people_first(
    before: RecorderState, event: Event, after: RecorderState, actions: tuple[Action, ...]
) -> None:
    rejected = next((action.why for action in actions if isinstance(action, Reject)), None)
    mine = before.recording == MINE
    if mine and after.recording != MINE:
        first = isinstance(before.phase, Beginning) and not before.phase.pause_s
        refused = first and isinstance(event, RunRefused)
        assert event == ENOUGH or refused  # only a person ends a person's recording, or a disk that never began it
    if event == StartRequested(MINE) and rejected == "running":
        assert mine and not isinstance(before.phase, Waiting)  # nothing but a person keeps a person waiting
    if event == StartRequested(THEIRS):
        assert (rejected is None) == (isinstance(before.phase, Idle) and len(before.leaving) < MOST_LEAVING)
    if event in (StartRequested(MINE), StartRequested(THEIRS)) and rejected:
        assert after == before and len(actions) == 1  # what is rejected changes nothing


def test_every_sequence_of_events():
    """All sequences of nine events; those that lead to the same point go on as one."""
    points: set[Point] = {(RecorderState(), World())}
    phases: set[type] = set()
    for _ in range(9):
        points = {follow(point, event) for point in points for event in events(point[1])}
        phases |= {type(state.phase) for state, _ in points}
    assert phases == {Idle, Beginning, Running, Waiting} and len(points) > 1000
    for state, world in points:
        _goes_on(state, world)


def _goes_on(state: RecorderState, world: World) -> None:
    """From everywhere: once the disk answers, what is to be recorded is recorded, and the rest is closed."""
    point = (state, world)
    for run in sorted(world.closing):
        point = follow(point, Closed(run))
    for run in sorted(world.asked):
        point = follow(point, Created(run))
    point = follow(point, Tick(LONG_S))
    for run in sorted(point[1].asked):
        point = follow(point, Created(run))
    assert isinstance(point[0].phase, Idle if state.recording is None else Running)
    assert point[0].recording == state.recording and not point[0].leaving


def _after(*happened: Event) -> RecorderState:
    point = (RecorderState(), World())
    for event in happened:
        point = follow(point, event)
    return point[0]


def test_pauses_double_up_to_a_minute():
    state, pauses, now_s = _after(StartRequested(MINE), Created(1), FULL, Closed(1)), [], 0.0
    for run in range(2, 9):
        assert isinstance(state.phase, Waiting)
        assert step(state, Tick(state.phase.due_s - 0.1)) == (state, ())
        pauses.append(state.phase.due_s - now_s)
        now_s = state.phase.due_s
        state = step(step(state, Tick(now_s))[0], RunRefused(run, now_s))[0]
    assert pauses == [FIRST_PAUSE_S, 5, 10, 20, 40, LONGEST_PAUSE_S, LONGEST_PAUSE_S]


def test_a_run_that_is_tried_again_has_the_run_before_closed():
    waiting = _after(StartRequested(MINE), Created(1), FULL)
    assert step(waiting, Tick(LONG_S)) == (waiting, ())
    assert step(step(waiting, Closed(1))[0], Tick(LONG_S))[1] == (Create(2, MINE, resumes=True),)


@pytest.mark.parametrize("happened", [(), (Created(1),), (Created(1), FULL)])
def test_a_person_takes_over_from_the_robot(happened):
    state, actions = step(_after(StartRequested(THEIRS), *happened), StartRequested(MINE))
    assert state.phase == Beginning(MINE, 2) and actions[-1] == Create(2, MINE)
    why = "a person started mine"
    ended = {
        0: state.leaving == (Close(1, "interrupted", why),),
        1: actions[:-1] == (Close(1, "interrupted", why),),
        2: actions[:-1] == (GiveUp(),),
    }
    assert ended[len(happened)]
