"""The clock of everything that acquires data: what time it is, and to wait. The one file of `daq` that asks the host.

It is the host's, unless a `Simulation` has taken its place in this process. The daemon's threads then run one at a
time: each runs until it waits for something here, and the simulation says which goes on, and what time it is by then.
So hours pass in seconds, and the same seed gives the same run.

`now_ns` and its like are names of this module that stand for the host's own functions: to stamp a byte costs one look
into a module and one call, as without this file. So say `clock.now_ns()`, and never import or keep the function.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from datetime import UTC, datetime
from functools import partial
from typing import Protocol, TypeVar

_T = TypeVar("_T")


def _boot_ns() -> int:
    # Linux alone has this clock, and rigd runs nowhere else; other systems import and simulate runs.
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME) if hasattr(time, "CLOCK_BOOTTIME") else time.monotonic_ns()


now_ns: Callable[[], int] = time.monotonic_ns
"""The monotonic clock, by which everything is stamped, ns."""
now_s: Callable[[], float] = time.monotonic
"""The same, s."""
wall_ns: Callable[[], int] = time.time_ns
"""The time of day, ns since 1970 UTC; a person may set it."""
boot_ns: Callable[[], int] = _boot_ns
"""The monotonic clock and the time that the computer slept, ns."""
worked_s: Callable[[], float] = time.thread_time
"""Processor time that this thread has taken, s."""
sleep: Callable[[float], None] = time.sleep
"""Wait for so many seconds."""


def wall_time() -> datetime:
    """Return the time of day, UTC."""
    return datetime.fromtimestamp(wall_ns() / 1e9, UTC)


class Simulation(Protocol):
    """A clock in place of the host's, which says as well which thread runs."""

    def now_ns(self) -> int:
        """Return the simulated monotonic time in ns."""

    def wall_ns(self) -> int:
        """Return the simulated time of day in ns since 1970 UTC."""

    def boot_ns(self) -> int:
        """Return the simulated monotonic time in ns, with the time that the computer slept."""

    def runs(self) -> bool:
        """Return whether the present thread is one of the simulation's; any other waits on the host's clock."""

    def wait(self, ready: Callable[[], bool], timeout_s: float | None) -> bool:
        """Let other threads run until `ready()` or until the time is over, None for no limit; return `ready()`."""

    def begin(self, thread: threading.Thread, body: Callable[[], None]) -> Callable[[], None]:
        """Take in a thread that is about to start with this body; return the body that it has to run instead."""

    def has_ended(self, thread: threading.Thread) -> bool:
        """Return whether the body of a thread that was taken in has come to its end."""


_simulation: Simulation | None = None


def _simulated() -> Simulation | None:
    """Return the simulation that the present thread is a part of."""
    return _simulation if _simulation is not None and _simulation.runs() else None


@contextmanager
def replaced_by(simulation: Simulation) -> Iterator[None]:
    """Let a simulation take the place of the host's clock in this process. No thread may be waiting here meanwhile."""
    global now_ns, now_s, wall_ns, boot_ns, worked_s, sleep, _simulation
    before = now_ns, now_s, wall_ns, boot_ns, worked_s, sleep, _simulation
    now_ns, wall_ns, boot_ns = simulation.now_ns, simulation.wall_ns, simulation.boot_ns
    now_s, worked_s = (lambda: simulation.now_ns() / 1e9), (lambda: 0.0)
    sleep, _simulation = _simulated_sleep, simulation
    try:
        yield
    finally:
        now_ns, now_s, wall_ns, boot_ns, worked_s, sleep, _simulation = before


def _simulated_sleep(seconds: float) -> None:
    if simulation := _simulated():
        simulation.wait(lambda: False, seconds)
    else:
        time.sleep(seconds)


class Event(threading.Event):
    """An event that threads wait for by this clock."""

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until the event is set, at most so many seconds; return whether it is set."""
        if simulation := _simulated():
            return simulation.wait(self.is_set, timeout)
        return super().wait(timeout)


class Thread(threading.Thread):
    """A thread that waits by this clock."""

    def start(self) -> None:
        """Begin to run."""
        if simulation := _simulated():
            self.run = simulation.begin(self, self.run)  # type: ignore[method-assign]
        super().start()

    def join(self, timeout: float | None = None) -> None:
        """Wait until the thread has ended, at most so many seconds."""
        simulation = _simulated()
        if simulation is not None and not simulation.wait(partial(simulation.has_ended, self), timeout):
            return
        super().join(timeout)


def result(future: Future[_T]) -> _T:
    """Wait for a future; return its result or raise its error."""
    if simulation := _simulated():
        simulation.wait(future.done, None)
    return future.result()


def one_thread(name: str) -> Executor:
    """Return an executor that does one thing after the other in a thread of this name."""
    return _OneThread(name) if _simulated() else ThreadPoolExecutor(1, name)


class _OneThread(Executor):
    """An executor whose thread is a simulation's, one for each thing to do, each of which waits for the one before."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._last: Future[object] | None = None

    def submit(self, fn, /, *args, **kwargs):  # type: ignore[no-untyped-def]
        before, done = self._last, Future[object]()
        self._last = done

        def work() -> None:
            if before is not None and (simulation := _simulated()):
                simulation.wait(before.done, None)
            try:
                result = fn(*args, **kwargs)
            except Exception as error:  # noqa: BLE001 - whoever waits for it is told, as by any executor
                done.set_exception(error)
            else:
                done.set_result(result)

        Thread(target=work, name=self._name, daemon=True).start()
        return done

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        if wait and self._last is not None and (simulation := _simulated()):
            simulation.wait(self._last.done, None)
