"""Life of a simulated world: disturbances, and the immediate reaction of the daemon to each."""

from __future__ import annotations

import gc
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from types import FunctionType, ModuleType
from typing import Any

from daq import clock
from daq.acquisition.host_clock import HOST
from daq.acquisition.streams import streams_of
from daq.emulators.simulated_cell import SimulatedCell
from daq.emulators.simulated_clock import SimulatedClock
from daq.protocol.conversation import FaultKind
from daq.service.daemon import Daemon
from daq.store.manifest import is_run
from rigs.errors import CellError, RigError
from rigs.load import parse
from tests.trials.storm.disk import Disk
from tests.trials.storm.ledger import Instruments
from tests.trials.storm.worlds import Blow, World, what_to_record

_COMES_BACK_S = 30.0
"""A reader pauses for 5 s at most between two tries; a conversation begins within some seconds."""
_GOES_ON_S = 140.0
"""A recording waits 60 s at most for another try of the disk, and what the disk was at may have to end before."""


@dataclass
class Heard:
    """Content of the daemon's log. wrong: forbidden messages; slow: number of reports of a slow disk."""

    wrong: list[str] = field(default_factory=list)
    slow: int = 0


@dataclass
class Asked:
    """A recording by hand: its first run, and between which times all that the daemon reads belongs to it."""

    path: Path
    from_ns: int
    to_ns: int | None = None
    daemon: int = 0
    """The number of the daemon that began it."""
    before: dict[str, int] = field(default_factory=dict)
    dropped: dict[str, int] | None = None
    """Samples of each stream that the status counted as dropped before it began, and since; None while not all of it
    is closed, since what is lost then is counted later."""
    synced: dict[str, int] = field(default_factory=dict)
    """Rows that were known to be synced when the daemon was killed."""
    killed_ns: int = 0
    """When the daemon was killed; 0 where it was not."""


@dataclass
class Told:
    """Result of a world. blows: disturbances by kind; hours: simulated and awake; violations: one line each."""

    world: World
    blows: Counter[Blow] = field(default_factory=Counter)
    violations: list[str] = field(default_factory=list)
    faults: Counter[str] = field(default_factory=Counter)
    """That runs name, by kind."""
    rows: int = 0
    runs: int = 0
    seconds: float = 0.0
    asleep_s: float = 0.0
    took_s: float = 0.0


class Life:
    """A simulated world from start to end; `live` returns the data to be checked."""

    def __init__(self, world: World, folder: Path, time_: SimulatedClock, heard: Heard) -> None:
        self.world, self.folder, self.time, self.heard = world, folder, time_, heard
        self.told = Told(world)
        self.dice = Random(world.seed * 7919 + 1)
        self.runs = folder / "runs"
        self.runs.mkdir()
        self.disk = Disk(self.runs, self.dice, forgets=Blow.POWER_CUT in world.blows)
        self.asked: list[Asked] = []
        self.befell: dict[str, set[Blow]] = {HOST: set()}
        """What has happened to each stream, and to the computer."""
        rig = parse(world.text, f"storm --seed {world.seed}")
        self.instruments = Instruments.of(rig, [stream.name for stream in streams_of(rig)])
        self.cell = SimulatedCell(time_, folder, world.text, self.instruments, self.instruments.signal)
        for line in self.cell.lines.values():
            self.instruments.attach(line)
            self.befell[line.name] = set()
        self.may_go: set[Path] = set()
        """Runs that were exported and not kept."""
        self.known: set[Path] = set()
        self.daemon: Daemon
        self._sizes: list[int] = []

    @property
    def gauges(self) -> int:
        return len(self.cell.rig.gauges.recorded)

    def wrong(self, what: str) -> None:
        """Note a violation."""
        self.told.violations.append(f"at {self.time.elapsed_s:.1f} s: {what}")

    def live(self, blows: Mapping[Blow, Callable[[Life], None]]) -> None:
        """Let the world pass. blows: how each kind is dealt."""
        self.start()
        self._until(self._all_read, _COMES_BACK_S, "not every stream is read")
        end_s = self.time.elapsed_s + self.world.seconds
        measured_s = self.time.elapsed_s + self.world.seconds / 2
        while self.time.elapsed_s < end_s:
            clock.sleep(self.dice.uniform(0.1, 1.0) * self.world.pause_s)
            if self.world.is_long and self.time.elapsed_s > measured_s and not self._sizes:
                self._sizes.append(_size_of(self.daemon))
            self._record_or_stop()
            if self.world.blows:
                blow = self.dice.choice(self.world.blows)
                self.told.blows[blow] += 1
                blows[blow](self)
            self.note_runs()
        self.end()

    def end(self) -> None:
        """Repair all disturbances, check normal operation, and end twice; the second start recovers the remaining
        runs.
        """
        self.mend()
        self._until(self._all_read, _COMES_BACK_S, "not every stream came back")
        self._until(lambda state: not state.get("waiting"), _GOES_ON_S, "the recording did not go on")
        self._stop()
        clock.sleep(2)
        self._until(lambda state: not state.get("closing"), _GOES_ON_S, "a run was not closed")
        waiting = {name: s["waiting"] for name, s in self.ask("status")["streams"].items() if s["waiting"] > 1000}
        if waiting:
            self.wrong(f"buffers do not empty: {waiting}")
        if self._sizes and (size := _size_of(self.daemon)) > 1.5 * self._sizes[0] + 5000:
            self.wrong(f"the daemon grew from {self._sizes[0]} to {size} objects in the second half")
        self._count_dropped()
        self.close()
        self.start()
        clock.sleep(3)
        self.close()
        self.note_runs()
        for error in self.time.errors:
            self.wrong(f"a thread died of {type(error).__name__}: {error}")

    def mend(self) -> None:
        """Repair all disturbances."""
        self.disk.heal()
        self.instruments.off.clear()
        self.instruments.program = 0
        self.instruments.drive(False)
        for line in self.cell.lines.values():
            line.plugged = True

    # The daemon

    def start(self) -> None:
        """Start a daemon, as the service manager does: again where a port did not open."""
        for _ in range(20):
            with suppress(CellError):
                self.daemon = self.cell.daemon()
                return
            clock.sleep(5)
            self.mend()
        self.wrong("no daemon starts")

    def close(self) -> None:
        """Stop the daemon normally; no files or processes remain."""
        with suppress(RigError):
            self.daemon.close("complete", "the world ends")
        left = [name for name in self.time.threads(f"rigd {self.cell.daemons}") if not name.startswith("emulated")]
        if left:
            self.wrong(f"threads are left: {', '.join(left)}")
        if open_files := _open_files(self.folder):
            self.wrong(f"files are left open: {', '.join(open_files)}")

    def ask(self, command: str, **more: Any) -> dict[str, Any]:
        """Ask the daemon. Raises RigError."""
        return self.daemon.answer({"command": command, **more})

    def counted(self, stream: str, *kinds: FaultKind) -> int:
        """Number of faults of these kinds that the daemon counted on a stream, or on the computer."""
        state = self.ask("status")
        counters = state[HOST] if stream == HOST else state["streams"][stream]["counters"]
        return sum(counters.get(kind, 0) for kind in kinds or FaultKind)

    def is_named(self, blow: Blow, stream: str, before: int, within_s: float, *kinds: FaultKind) -> None:
        """See that a fault of these kinds is counted on a stream within some time."""
        until_s = self.time.elapsed_s + within_s
        while self.counted(stream, *kinds) <= before:
            if self.time.elapsed_s >= until_s:
                self.wrong(f"{blow} of {stream} is not named")
                return
            clock.sleep(0.25)

    def _until(self, what: Callable[[dict[str, Any]], bool], within_s: float, told: str) -> None:
        until_s = self.time.elapsed_s + within_s
        while not what(state := self.ask("status")):
            if self.time.elapsed_s > until_s:
                streams = {name: (s["connected"], s["age_s"], s["last_fault"]) for name, s in state["streams"].items()}
                self.wrong(f"{told} within {within_s:.0f} s: {streams if 'stream' in told else state['last_end']}")
                return
            clock.sleep(0.5)

    def _all_read(self, state: dict[str, Any]) -> bool:
        return all(len(s["age_s"]) and max(s["age_s"].values()) < 3.5 for s in state["streams"].values())

    # Recordings

    def _record_or_stop(self) -> None:
        if self.dice.random() < (0.2 if self.world.is_long else 0.6) and not self.ask("status").get("recording"):
            self.record()
        elif self.dice.random() < (0.7 if self.world.is_long else 0.25):
            self._stop()

    def record(self) -> None:
        """Begin a recording by hand."""
        self._count_dropped()
        from_ns, before = clock.now_ns(), self._dropped()
        try:
            path = self.ask("record_start", name="storm", **what_to_record(self.gauges))["run"]
        except RigError as error:
            if not any(self.befell.values()) and "already running" not in str(error):
                self.wrong(f"a recording was refused, and nothing had happened: {error}")
            return
        self.asked.append(Asked(Path(path), from_ns, daemon=self.cell.daemons, before=before))

    def _stop(self) -> None:
        now_ns, state = clock.now_ns(), self.ask("status")
        try:
            self.ask("record_stop")
        except RigError as error:
            if state.get("recording") and not self.befell[HOST]:
                self.wrong(f"a recording could not be stopped, and nothing had happened: {error}")
        self.ended(now_ns)

    def ended(self, now_ns: int) -> None:
        """Note that the recording by hand ended, 0 where nobody knows when."""
        if self.asked and self.asked[-1].to_ns is None:
            self.asked[-1].to_ns = now_ns

    def _dropped(self) -> dict[str, int]:
        streams = self.ask("status")["streams"]
        return {name: state["counters"].get(FaultKind.DROPPED, 0) for name, state in streams.items()}

    def _count_dropped(self) -> None:
        """Note how many samples were dropped since the last recording by hand began."""
        if self.asked and self.asked[-1].daemon == self.cell.daemons:
            asked, state = self.asked[-1], self.ask("status")
            now = {} if state.get("closing") else self._dropped()
            asked.dropped = {name: count - asked.before[name] for name, count in now.items()} or None

    def note_runs(self) -> None:
        """Note which runs are there, and see that none is gone that may not go."""
        there = {path for path in self.runs.iterdir() if not path.name.startswith(".") and is_run(path)}
        for path in self.known - there - self.may_go:
            self.wrong(f"{path.name} is gone")
        self.known = there

    def kill(self) -> None:
        """Kill the daemon, and note what is known to be on the disk, which a kill or a power cut must leave."""
        state = self.ask("status")
        if state.get("recording"):
            found = next((asked for asked in self.asked if str(asked.path) == state["run"]), None)
            if found is None:
                self.asked.append(found := Asked(Path(state["run"]), clock.now_ns()))
            found.synced, found.killed_ns = dict(state["synced"]), clock.now_ns()
        for asked in self.asked:
            if asked.to_ns is None:
                asked.to_ns = 0
        self.disk.gone = True
        self.cell.kill(self.daemon)
        self.disk.gone = False


def _open_files(folder: Path) -> list[str]:
    found = []
    for entry in Path("/proc/self/fd").iterdir():
        with suppress(OSError):
            if str(target := entry.readlink()).startswith(f"{folder}/"):
                found.append(str(target.relative_to(folder)))
    return found


def _size_of(root: object) -> int:
    """The number of objects that are reachable from one, without the program itself."""
    gc.collect()
    seen, left = {id(root)}, [root]
    while left:
        for other in gc.get_referents(left.pop()):
            if id(other) not in seen and not isinstance(other, type | ModuleType | FunctionType):
                seen.add(id(other))
                left.append(other)
    return len(seen)
