"""Faults of a world. Each waits until the daemon has had time to report it, and checks the report."""

from __future__ import annotations

import errno
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import datetime
from random import Random
from typing import Any

from daq import clock
from daq.acquisition.host_clock import HOST
from daq.acquisition.streams import ROBOT
from daq.emulators.simulated_cell import SimulatedLine
from daq.protocol.conversation import FaultKind
from daq.store import load_manifest
from daq.store.manifest import is_run
from daq.store.marks import load_marks, mark_exported, mark_kept
from rigs.errors import RigError
from tests.trials.storm.disk import Disk
from tests.trials.storm.life import Life
from tests.trials.storm.worlds import Blow

_DAY_S, _HOUR_S = 86_400, 3600.0
_LOGGED_AGAIN_S = 13.0
"""The log has a line of one kind every ten seconds, and says of a sync after two that it is slow."""

GARBLED = {
    FaultKind.GARBLED, FaultKind.MISSHAPEN, FaultKind.SILENT, FaultKind.LATE, FaultKind.SKIPPED, FaultKind.MISSING,
    FaultKind.DEVICE_ERROR, FaultKind.DISCONNECTED, FaultKind.UNIT_CHANGED, FaultKind.DOUBTFUL,
}  # fmt: skip
"""Faults that may name changed bytes."""


def _line_that_reads(life: Life, blow: Blow) -> SimulatedLine | None:
    """A line on which readings come, noted as one that this blow befell."""
    line = life.cell.lines[life.dice.choice(sorted(life.cell.lines))]
    life.befell[line.name].add(blow)
    state = life.ask("status")["streams"][line.name]
    reads = state["connected"] and state["age_s"] and max(state["age_s"].values()) < 0.5 * _patience_s(life, line)
    return line if reads else None


def _timeout_s(life: Life, line: SimulatedLine) -> float:
    """Timeout of the daemon on a line."""
    rig = life.cell.rig
    device = rig.feedback if line.name == ROBOT else rig.gauges.recorded[line.name.split("_")[0]]
    return device.timeout_s


def _patience_s(life: Life, line: SimulatedLine) -> float:
    """Timeout of the daemon on a line, plus the time for the next reading."""
    return _timeout_s(life, line) + (2.5 if life.world.is_long else 0.5)


@contextmanager
def _named(life: Life, blow: Blow, line: SimulatedLine, within_s: float, *kinds: FaultKind) -> Iterator[None]:
    """See that a fault of these kinds is counted soon after what the context does to a line."""
    before = life.counted(line.name, *kinds)
    yield
    life.is_named(blow, line.name, before, within_s, *kinds)


def _cable(life: Life) -> None:
    if (line := _line_that_reads(life, Blow.CABLE)) is not None:
        with _named(life, Blow.CABLE, line, 1.0, FaultKind.DISCONNECTED):
            line.unplug()
        clock.sleep(life.dice.uniform(0.0, 12.0))
        line.plugged = True


def _reset(life: Life) -> None:
    if (line := _line_that_reads(life, Blow.RESET)) is not None:
        with _named(life, Blow.RESET, line, 1.0, FaultKind.DISCONNECTED):
            line.reset()


def _late(life: Life) -> None:
    """One piece comes late, and what follows it on the line with it: later than the daemon waits, and not so late that
    no protocol could know it."""
    if (line := _line_that_reads(life, Blow.LATE)) is not None:
        timeout_s = _timeout_s(life, line)
        silent = FaultKind.SILENT, FaultKind.LATE, FaultKind.DISCONNECTED
        with _named(life, Blow.LATE, line, 8 * timeout_s + 3, *silent):
            _change_one(life, line, lambda data: (data, round(life.dice.uniform(1.2, 1.7) * timeout_s * 1e9)))


def _cut(life: Life) -> None:
    _garble(life, Blow.CUT, lambda data: data[: max(1, len(data) // 2)])


def _junk(life: Life) -> None:
    _garble(life, Blow.JUNK, lambda data: data[: len(data) // 2] + b"\xfe\xff\xfe" + data[len(data) // 2 :])


def _garble(life: Life, blow: Blow, change: Callable[[bytes], bytes]) -> None:
    if (line := _line_that_reads(life, blow)) is not None:
        with _named(life, blow, line, 4 * _patience_s(life, line), *GARBLED):
            _change_one(life, line, lambda data: (change(data), 0))


def _change_one(life: Life, line: SimulatedLine, change: Callable[[bytes], tuple[bytes, int]]) -> None:
    """Change the next piece with a reading in it that the instrument sends."""
    done = []

    def once(data: bytes) -> tuple[bytes, int]:
        if not life.instruments.is_reading(line.name):
            return data, 0
        line.change = lambda data: (data, 0)
        done.append(data)
        return change(data)

    line.change = once
    until_s = life.time.elapsed_s + 10
    while not done and life.time.elapsed_s < until_s:
        clock.sleep(0.05)


def _head_off(life: Life) -> None:
    name = life.dice.choice(sorted(life.cell.rig.gauges.recorded))
    stream = life.instruments.streams[name]
    life.befell[stream].add(Blow.HEAD_OFF)
    before = life.counted(stream, *GARBLED)
    life.instruments.off.add(name)
    clock.sleep(life.dice.uniform(1.0, 3.0) + (4.0 if life.world.is_long else 0.0))
    if life.ask("status")["streams"][stream]["connected"]:
        life.is_named(Blow.HEAD_OFF, stream, before, 3.0, *GARBLED)
    life.instruments.off.discard(name)


def _clock_set(life: Life) -> None:
    life.befell[HOST].add(Blow.CLOCK)
    before = life.counted(HOST, FaultKind.CLOCK)
    life.time.set_ns += round(life.dice.choice((-1, 1)) * 10 ** life.dice.uniform(-1.5, 4) * 1e9)
    life.is_named(Blow.CLOCK, HOST, before, 2.0, FaultKind.CLOCK)


def _sleep(life: Life) -> None:
    life.befell[HOST].add(Blow.SLEEP)
    before = life.counted(HOST, FaultKind.CLOCK)
    slept_ns = round(10 ** life.dice.uniform(0, 4.5) * 1e9)
    life.time.slept_ns += slept_ns
    life.told.asleep_s += slept_ns / 1e9
    life.is_named(Blow.SLEEP, HOST, before, 2.0, FaultKind.CLOCK)


def _program(life: Life) -> None:
    """The robot shows that its program runs, drives, and stands: a run by itself, unless a person's is under way."""
    state = life.ask("status")
    free = not state.get("recording") and not state.get("waiting") and not any(life.befell.values())
    started = state["automatic"]["started"]
    life.instruments.program = 1
    life.instruments.drive(True)
    clock.sleep(life.dice.uniform(2.0, 6.0))
    life.instruments.program = 0
    life.instruments.drive(False)
    clock.sleep(3.0)
    state = life.ask("status")["automatic"]
    if free and state["started"] != started + 1:
        life.wrong(f"the robot's program began no run: {state}")
    if free and state["recording"]:
        life.wrong("the run of the robot's program was not ended")


def _disk_blow(life: Life, blow: Blow, strike: Callable[[Disk], None]) -> None:
    seconds = life.dice.uniform(1.5, 8.0)
    life.befell[HOST].add(blow)
    recording = life.ask("status").get("recording")
    refused = life.disk.refused
    strike(life.disk)
    clock.sleep(seconds)
    state = life.ask("status")
    is_hit = blow is Blow.FULL or life.disk.refused > refused
    if recording and is_hit:
        if state.get("recording") and not state.get("waiting"):
            life.wrong(f"{blow}: the run goes on as if nothing were")
        if not state.get("recording") and not state["last_end"]:
            life.wrong(f"{blow} is not named")
    life.disk.heal()


def _full(life: Life) -> None:
    _disk_blow(life, Blow.FULL, lambda disk: setattr(disk, "full", True))


def _quota(life: Life) -> None:
    _fail(life, Blow.QUOTA, ("pwrite", "mkdir"), errno.ENOSPC)


def _failing(life: Life) -> None:
    calls = life.dice.sample(("pwrite", "fsync", "open", "replace", "unlink", "mkdir", "ftruncate"), 3)
    _fail(life, Blow.FAILING, calls, errno.EIO)


def _fail(life: Life, blow: Blow, calls: Sequence[str], number: int) -> None:
    # A disk that refuses only what nobody calls just now has refused nothing.
    _disk_blow(life, blow, lambda disk: disk.failing.update(dict.fromkeys(calls, number)))


def _slow(life: Life) -> None:
    life.befell[HOST].add(Blow.SLOW)
    told, recording = life.heard.slow, life.ask("status").get("recording")
    life.disk.syncs_s = 10 ** life.dice.uniform(0, 1.3)
    seconds = life.dice.uniform(2.0, 25.0)
    clock.sleep(seconds)
    went_on = recording and recording == life.ask("status").get("recording")
    if went_on and life.disk.syncs_s > 2.5 and seconds > _LOGGED_AGAIN_S and life.heard.slow == told:
        life.wrong("a disk whose syncs take seconds is not named in the log")
    life.disk.syncs_s = 0.0


def _flood(life: Life) -> None:
    """Clients that ask for everything and nonsense, at once."""
    nonsense: list[dict[str, Any]] = [
        {}, {"command": None}, {"command": "x" * 10_000}, {"command": "samples", "after": {"g1": -1}},
        {"command": "record_start", "name": "../../x", "test": "yaw"}, {"command": "record_start"},
        {"command": "judged", "run": 1}, {"command": "samples", "after": []},
    ]  # fmt: skip
    sense: list[dict[str, Any]] = [{"command": "status"}, {"command": "metrics"}, {"command": "samples", "after": {}}]

    def client(dice: Random) -> None:
        for _ in range(20):
            with suppress(RigError):
                life.daemon.answer(dict(dice.choice(nonsense + sense)))
            clock.sleep(dice.uniform(0, 0.01))

    with life.time.process("clients"):
        for number in range(8):
            dice = Random(f"{life.world.seed} {number} {life.time.elapsed_s}")
            clock.Thread(target=client, args=(dice,), name=f"client {number}", daemon=True).start()
    clock.sleep(1.0)


def _kill(life: Life) -> None:
    clock.sleep(life.dice.uniform(0, 1.0))
    life.kill()
    life.note_runs()
    clock.sleep(life.dice.uniform(0, 2.0))
    _start_again(life)


def _power_cut(life: Life) -> None:
    """The power goes, mostly while the disk is still at what it was given."""
    life.disk.syncs_s = life.dice.choice((0.0, 0.5, 1.0))
    clock.sleep(life.dice.uniform(0, 3.0))
    life.kill()
    life.disk.syncs_s = 0.0
    life.disk.cut_power()
    promised = {asked.path for asked in life.asked if asked.synced}
    for path in sorted(path for path in promised if not is_run(path)):
        life.wrong(f"{path.name} is gone after a power cut")
    life.known = {path for path in life.known if is_run(path)}
    _start_again(life)


def _start_again(life: Life) -> None:
    """The next start recovers what was left: runs that cannot be read are found at the end."""
    life.start()
    clock.sleep(life.dice.uniform(0.5, 3.0))


def _restart(life: Life) -> None:
    life.close()
    life.ended(0)
    life.start()
    clock.sleep(1.0)


def _days_pass(life: Life) -> None:
    """Some runs are exported, some of them kept, and days pass; the next start applies the retention."""
    closed = [path for path in sorted(life.known) if load_manifest(path).exit_status != "recording"]
    for path in closed:
        with suppress(RigError):
            if life.dice.random() < 0.5:
                mark_exported(path, "csv", life.folder / "x.csv")
            if life.dice.random() < 0.3:
                mark_kept(path, kept=True)
    ended_s = {path: datetime.fromisoformat(m.ended).timestamp() for path in closed if (m := load_manifest(path)).ended}
    life.may_go = {path for path in closed if load_marks(path).exports and not load_marks(path).kept}
    life.befell[HOST].add(Blow.RETENTION)
    life.time.slept_ns += life.dice.randint(1, 4) * _DAY_S * 10**9
    clock.sleep(_HOUR_S / 4)
    now_s = clock.wall_ns() / 1e9
    for path in closed:
        is_old = path in ended_s and now_s - ended_s[path] > 2 * _DAY_S + _HOUR_S
        if path in life.may_go and is_old and path.exists():
            life.wrong(f"{path.name} was exported and is too old, and it is still there")


BLOWS: dict[Blow, Callable[[Life], None]] = {
    Blow.CABLE: _cable, Blow.RESET: _reset, Blow.LATE: _late, Blow.CUT: _cut, Blow.JUNK: _junk,
    Blow.HEAD_OFF: _head_off, Blow.CLOCK: _clock_set, Blow.SLEEP: _sleep, Blow.FULL: _full, Blow.QUOTA: _quota,
    Blow.FAILING: _failing, Blow.SLOW: _slow, Blow.FLOOD: _flood, Blow.KILL: _kill, Blow.POWER_CUT: _power_cut,
    Blow.RESTART: _restart, Blow.PROGRAM: _program, Blow.RETENTION: _days_pass,
}  # fmt: skip
