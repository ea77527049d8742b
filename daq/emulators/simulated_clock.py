"""Simulated clock for threads of a single process. Only one thread runs at a time, and time passes only while all
threads wait.

A seed determines the next thread and the short duration of each turn, so that a failure can be repeated.
"""

from __future__ import annotations

import contextlib
import os
import random
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from daq import clock

S = 1_000_000_000
_BEGIN_NS = 1000 * S
_WALL_NS = 1_767_225_600 * S
"""2026-01-01 UTC."""
_STEP_NS = (1_000, 20_000)
"""Range of the time that a thread takes between two waits."""
_HANGS_S = 60.0
"""Real time after which a thread that does not wait is assumed to hang outside of the clock."""


class Deadlock(Exception):
    """All threads wait indefinitely."""


class Killed(BaseException):
    """The process of this thread was killed."""


@dataclass(eq=False)
class _Task:
    thread: threading.Thread
    group: str
    ready: Callable[[], bool] = lambda: True
    due_ns: int | None = None
    killed: bool = False
    go: threading.Lock = field(default_factory=threading.Lock)
    """Lock that is free only during the turn of this thread."""

    def __post_init__(self) -> None:
        self.go.acquire()


class SimulatedClock:
    def __init__(self, seed: int, hangs_s: float = _HANGS_S, began_wall_ns: int = _WALL_NS + _BEGIN_NS) -> None:
        """began_wall_ns: initial wall time in ns since 1970."""
        self.seed, self._hangs_s, self._began_wall_ns = seed, hangs_s, began_wall_ns
        self.errors: list[BaseException] = []
        self.slept_ns = self.set_ns = 0
        self._dice = random.Random(seed)
        self._ns = _BEGIN_NS
        self._tasks: dict[threading.Thread, _Task] = {}
        self._stuck = False
        self._turns = 0
        self._driver: _Task | None = None
        self._running: _Task | None = None
        self._interrupted = False

    @contextmanager
    def running(self) -> Iterator[SimulatedClock]:
        """Replace the clock of the host. Remaining threads are killed at the end. Errors include the seed."""
        main = threading.current_thread()
        self._tasks[main] = self._driver = self._running = _Task(main, "")
        try:
            with clock.replaced_by(self):
                try:
                    yield self
                finally:
                    self.kill(*{task.group for task in self._tasks.values()} - {""})
        except Exception as error:
            error.add_note(f"simulated with seed {self.seed}, after {self.elapsed_s:.1f} s")
            raise

    @property
    def elapsed_s(self) -> float:
        return (self._ns - _BEGIN_NS) / S

    def now_ns(self) -> int:
        return self._ns

    def boot_ns(self) -> int:
        return self._ns + self.slept_ns

    def wall_ns(self) -> int:
        return self._began_wall_ns + self.boot_ns() - _BEGIN_NS + self.set_ns

    def runs(self) -> bool:
        return threading.current_thread() in self._tasks

    def wait(self, ready: Callable[[], bool], timeout_s: float | None) -> bool:
        me = self._tasks[threading.current_thread()]
        me.ready, me.due_ns = ready, None if timeout_s is None else self._ns + max(0, round(timeout_s * S))
        self._hand_over(me)
        if me.killed:
            raise Killed
        if me is self._driver and self._interrupted:
            self._interrupted = False
            raise KeyboardInterrupt
        if self._stuck:
            names = ", ".join(task.thread.name for task in self._tasks.values())
            raise Deadlock(f"all threads wait without a timeout: {names}")
        return ready()

    def begin(self, thread: threading.Thread, body: Callable[[], None]) -> Callable[[], None]:
        task = self._tasks[thread] = _Task(thread, self._tasks[threading.current_thread()].group or thread.name)
        task.due_ns = self._ns

        def run() -> None:
            task.go.acquire()
            try:
                if not task.killed:
                    body()
            except Killed:
                pass
            except Exception as error:  # noqa: BLE001 - whoever drives the clock is to see it
                self.errors.append(error)
            finally:
                del self._tasks[thread]
                self._hand_over(None)

        return run

    def stall(self, seconds: float) -> None:
        """Advance the time while no thread runs, as when the computer stands still."""
        self._ns += round(seconds * S)

    def has_ended(self, thread: threading.Thread) -> bool:
        return thread not in self._tasks

    @contextmanager
    def process(self, name: str) -> Iterator[None]:
        """Assign the threads started in this block, and all their descendants, to a named process."""
        me = self._tasks[threading.current_thread()]
        before, me.group = me.group, name
        try:
            yield
        finally:
            me.group = before

    def threads(self, process: str) -> list[str]:
        return [task.thread.name for task in self._tasks.values() if task.group == process]

    def kill(self, *processes: str) -> None:
        doomed = [task for task in self._tasks.values() if task.group in processes]
        for task in doomed:
            task.killed, task.ready = True, lambda: True
        me = self._tasks[threading.current_thread()]
        while any(task in self._tasks.values() for task in doomed):
            me.ready, me.due_ns = (lambda: False), self._ns
            self._hand_over(me)

    def interrupt(self) -> None:
        """Raise KeyboardInterrupt in the calling thread, which drives the clock, at its next turn."""
        if self._running is self._driver:
            raise KeyboardInterrupt
        self._interrupted = True

    def _hand_over(self, me: _Task | None) -> None:
        """Let the next thread run and return at the next turn of this thread. me: None for a thread that ends."""
        chosen = self._next()
        self._ns += self._dice.randrange(*_STEP_NS)
        self._turns += 1
        self._running = chosen
        if chosen is me:
            return
        chosen.go.release()
        turn = self._turns
        while me is not None and not me.go.acquire(timeout=self._hangs_s):
            if self._turns == turn:
                raise Deadlock(f"{chosen.thread.name} never waits")
            turn = self._turns

    def _next(self) -> _Task:
        tasks = list(self._tasks.values())
        if not (able := [task for task in tasks if task.killed or task.ready()]):
            timed = [task.due_ns for task in tasks if task.due_ns is not None]
            if not timed:
                self._stuck = True
                return tasks[0]
            self._ns = max(self._ns, min(timed))
            able = [task for task in tasks if task.due_ns is not None and task.due_ns <= self._ns]
        return able[0] if len(able) == 1 else self._dice.choice(able)


def close_files_in(folder: Path) -> None:
    """Close every file and directory of this folder that is open in this process, as a kill does."""
    for entry in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(OSError):
            if str(entry.readlink()).startswith(f"{folder}/"):
                os.close(int(entry.name))
