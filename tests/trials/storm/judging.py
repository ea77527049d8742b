"""Comparison of recorded runs with the samples sent by the instruments of a simulated cell."""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Sequence

from daq.acquisition.host_clock import HOST
from daq.protocol.conversation import FaultKind
from daq.store import Run, read_run
from daq.store.manifest import is_run
from daq.store.verify import judge
from rigs.errors import RigError
from tests.trials.storm.blows import GARBLED
from tests.trials.storm.ledger import Piece, held
from tests.trials.storm.life import Asked, Life
from tests.trials.storm.worlds import Blow

_ENDS_NS = 300_000_000
"""A reader may gather for 0.1 s before it hands on what it has read."""
_TAIL_NS = 1_500_000_000
"""The most that a kill takes of what was not synced: rounds of the recorder are 0.25 s apart."""
_SPOILT_NS = 6_000_000_000
"""For so long after a change of its bytes a protocol may leave out what came: it drains its line, resynchronises, and
bears out a shape again."""
_LINE = {FaultKind.DISCONNECTED, FaultKind.SILENT}
_MAY_NAME = {
    Blow.CABLE: _LINE,
    Blow.RESET: _LINE,
    # A KUKA whose messages come late hears late answers, and says so.
    Blow.LATE: {FaultKind.SILENT, FaultKind.LATE, FaultKind.DISCONNECTED, FaultKind.DEVICE_ERROR},
    Blow.CUT: GARBLED,
    Blow.JUNK: GARBLED,
    Blow.HEAD_OFF: {FaultKind.DEVICE_ERROR, FaultKind.MISSING, FaultKind.DOUBTFUL},
    Blow.CLOCK: {FaultKind.CLOCK},
    Blow.SLEEP: {FaultKind.CLOCK},
    Blow.RETENTION: {FaultKind.CLOCK},
}
"""Which faults are no false alarms after a blow."""
STOPPED = "stopped by rig record stop"
_DISK = {Blow.FULL, Blow.QUOTA, Blow.FAILING, Blow.SLOW}


def judge_runs(life: Life) -> None:
    """Hold every run that is left to the ledger of its instruments."""
    runs: dict[str, Run] = {}
    for path in sorted(path for path in life.runs.iterdir() if not path.name.startswith(".") and is_run(path)):
        try:
            runs[path.name] = read_run(path)
            for line in judge(path).lines:
                life.told.violations.append(f"{path.name}: {line}")
        except RigError as error:
            life.told.violations.append(f"{path.name}: cannot be read: {error}")
    life.told.runs = len(runs)
    asked = {one.path.name: one for one in life.asked}
    for chain in _chains(runs):
        known = next((asked[run.path.name] for run in chain if run.path.name in asked), None)
        for stream in life.instruments.pieces:
            _judge_stream(life, chain, stream, known)
    for run in runs.values():
        _judge_faults(life, run)
    for one in life.asked:
        if one.killed_ns and one.path.name in runs:
            _judge_killed(life, runs[one.path.name], one)
        if one.path.name not in runs and one.path not in life.may_go:
            life.told.violations.append(f"{one.path.name} was begun, and is not there")


def _chains(runs: dict[str, Run]) -> list[list[Run]]:
    """Runs that go on from one another, in order."""
    following = defaultdict(list)
    for run in runs.values():
        following[run.manifest.follows].append(run)
    chains = []
    for run in runs.values():
        if run.manifest.follows not in runs:
            chain = [run]
            while following[chain[-1].path.name]:
                chain.append(following[chain[-1].path.name][0])
            chains.append(chain)
    return chains


def _judge_stream(life: Life, chain: Sequence[Run], stream: str, asked: Asked | None) -> None:
    pieces = life.instruments.pieces[stream]
    names = [name for name, of in life.instruments.streams.items() if of == stream]
    places, dropped = set[int](), 0
    for run in chain:
        rows = run.streams[stream]
        life.told.rows += len(rows["last_byte_ns"])
        for name in names:
            own, problems = held(name, rows, pieces)
            life.told.violations += [f"{run.path.name}: {problem}" for problem in problems]
            if own & places and name == names[0]:
                life.told.violations.append(f"{run.path.name}: {name}: rows are in two runs")
            places |= own
        dropped += run.manifest.counters.get(stream, {}).get(FaultKind.DROPPED, 0)
    _judge_missing(life, chain, stream, asked, places, dropped)


def _judge_killed(life: Life, run: Run, asked: Asked) -> None:
    """Require all data synced before a kill and, if the disk was healthy, all data except the last moments."""
    for stream, synced in asked.synced.items():
        rows, pieces = run.streams[stream]["last_byte_ns"], life.instruments.pieces[stream]
        if len(rows) < synced:
            life.told.violations.append(f"{run.path.name}: {len(rows)} rows of {stream}, {synced} were synced")
        if Blow.POWER_CUT in life.world.blows or _DISK & life.befell[HOST]:
            continue
        last_ns = int(rows[-1]) if len(rows) else asked.from_ns
        until_ns = asked.killed_ns - _TAIL_NS
        came_ns = last_ns + _ENDS_NS
        tail = [p for p in pieces if p.read_ns and not p.greets and came_ns < p.read_ns < until_ns]
        if any(not piece.broken and piece.has_reading for piece in tail):
            lost_s = (asked.killed_ns - last_ns) / 1e9
            life.told.violations.append(f"{run.path.name}: the last {lost_s:.1f} s of {stream} before a kill are lost")


def _judge_missing(
    life: Life, chain: Sequence[Run], stream: str, asked: Asked | None, places: set[int], dropped: int
) -> None:
    """Require that each message read during a recording is a row or counted as dropped."""
    pieces = life.instruments.pieces[stream]
    begin_ns, end_ns = (pieces[min(places)].at_ns, pieces[max(places)].at_ns) if places else (0, 0)
    if asked:
        begin_ns = asked.from_ns + _ENDS_NS // 100
        if chain[-1].manifest.reason == STOPPED:
            end_ns = max(end_ns, (asked.to_ns or 0) - _ENDS_NS)
        elif asked.to_ns and asked.dropped is not None:  # given up: what came until then is counted in the status alone
            end_ns, dropped = max(end_ns, asked.to_ns - _ENDS_NS), max(dropped, asked.dropped.get(stream, 0))
    if stream in life.instruments.in_two:
        places = {place + beside for place in places for beside in (-1, 0, 1)}
    missing = [
        place
        for place, piece in enumerate(pieces)
        if piece.read_ns and not piece.greets and begin_ns <= piece.read_ns and piece.at_ns <= end_ns
        and place not in places
        and piece.has_reading
    ]  # fmt: skip
    sure = [place for place in missing if not _is_spoilt(pieces, place)]
    if len(sure) > dropped * (2 if stream in life.instruments.in_two else 1):
        when = [round(pieces[place].at_ns / 1e9 - 1000, 3) for place in sure[:4]]
        told = f"{len(sure)} messages of {stream} were read and are no rows, {dropped} are counted as dropped"
        life.told.violations.append(f"{chain[0].path.name}: {told}; the first came at {when} s")
    if asked and chain[-1].manifest.reason == STOPPED and dropped > (room := _readings_besides(pieces, asked, places)):
        told = f"{dropped} samples of {stream} are counted as dropped, and only {room} that came are no rows"
        life.told.violations.append(f"{chain[0].path.name}: {told}")


def _readings_besides(pieces: Sequence[Piece], asked: Asked, places: set[int]) -> int:
    """The most samples that came about the time of a recording and are no rows of it."""
    begin_ns, end_ns = asked.from_ns - _ENDS_NS, (asked.to_ns or 0) + _ENDS_NS
    return sum(
        max(map(len, piece.readings.values()), default=0)
        for place, piece in enumerate(pieces)
        if piece.read_ns and begin_ns <= piece.read_ns <= end_ns and place not in places
    )


def _is_spoilt(pieces: Sequence[Piece], place: int) -> bool:
    """True if a protocol may omit a message, because bytes were changed or an answer was late shortly before."""
    since_ns = pieces[place].at_ns - _SPOILT_NS
    before = itertools.takewhile(lambda piece: piece.at_ns >= since_ns, reversed(pieces[: place + 1]))
    return any(piece.broken or piece.late for piece in before)


def _judge_faults(life: Life, run: Run) -> None:
    """Every fault that a run names has a cause. A small room is full of a quick gauge between two emptyings: what is
    dropped of it is counted, and needs no slow disk."""
    for fault in run.faults:
        stream, kind = fault["stream"], FaultKind(fault["kind"])
        life.told.faults[kind] += fault["count"]
        may = set().union(*(_MAY_NAME.get(blow, set()) for blow in life.befell[stream]))
        if kind is FaultKind.DROPPED and (life.world.small or _DISK & life.befell[HOST]):
            continue
        if kind not in may:
            told = f"{kind} of {stream}, which nothing has caused: {fault['detail']}"
            life.told.violations.append(f"{run.path.name}: false alarm: {told}")
