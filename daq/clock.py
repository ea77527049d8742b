"""Clock of the data acquisition. Other modules of `daq` must not use the time functions of the host.

A `ClockSimulation` can replace the host's clock in a process. The threads of the daemon then run in turn: each until it
waits here, and the simulation chooses the next thread and advances the time. Always call `clock.now_ns()`, and never
import or store the function itself.
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


now_ns: Callable[[], int] = time.monotonic_ns
"""Monotonic clock used for all timestamps, in ns."""
now_s: Callable[[], float] = time.monotonic
wall_ns: Callable[[], int] = time.time_ns
"""Wall clock, in ns since 1970 UTC. The user can set it."""
boot_ns: Callable[[], int] = (
    partial(time.clock_gettime_ns, time.CLOCK_BOOTTIME) if hasattr(time, "CLOCK_BOOTTIME") else time.monotonic_ns
)
"""Monotonic clock including suspends, in ns. Only Linux has it, and rigd requires Linux; other systems import runs."""
worked_s: Callable[[], float] = time.thread_time
sleep: Callable[[float], None] = time.sleep


def wall_time() -> datetime:
    return datetime.fromtimestamp(wall_ns() / 1e9, UTC)


class ClockSimulation(Protocol):
    def now_ns(self) -> int:
        """Monotonic time in ns."""

    def wall_ns(self) -> int:
        """Wall time in ns since 1970 UTC."""

    def boot_ns(self) -> int:
        """Monotonic time in ns, including suspends."""

    def runs(self) -> bool:
        """True if the current thread is simulated. Other threads use the host's clock."""

    def wait(self, ready: Callable[[], bool], timeout_s: float | None) -> bool:
        """Run other threads until `ready()` or the time-out, then return `ready()`. None means unlimited."""

    def begin(self, thread: threading.Thread, body: Callable[[], None]) -> Callable[[], None]:
        """Register a thread before it starts, and return a replacement for its body."""

    def has_ended(self, thread: threading.Thread) -> bool:
        """True if the body of a registered thread has finished."""


_simulation: ClockSimulation | None = None


def _simulated() -> ClockSimulation | None:
    return _simulation if _simulation is not None and _simulation.runs() else None


@contextmanager
def replaced_by(simulation: ClockSimulation) -> Iterator[None]:
    """Replace the host's clock in this process by a simulation. Threads must not be waiting here at that time."""
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
    def wait(self, timeout: float | None = None) -> bool:
        if simulation := _simulated():
            return simulation.wait(self.is_set, timeout)
        return super().wait(timeout)


class Thread(threading.Thread):
    def start(self) -> None:
        if simulation := _simulated():
            self.run = simulation.begin(self, self.run)  # type: ignore[method-assign]
        super().start()

    def join(self, timeout: float | None = None) -> None:
        simulation = _simulated()
        if simulation is not None and not simulation.wait(partial(simulation.has_ended, self), timeout):
            return
        super().join(timeout)


class StoppableThread(Thread):
    """Daemon thread whose `run` ends soon after `stop`."""

    def __init__(self, name: str) -> None:
        super().__init__(name=name, daemon=True)
        self._stop_asked = Event()

    def stop(self) -> None:
        self._stop_asked.set()


def result(future: Future[_T]) -> _T:
    if simulation := _simulated():
        simulation.wait(future.done, None)
    return future.result()


def one_thread(name: str) -> Executor:
    return _OneThread(name) if _simulated() else ThreadPoolExecutor(1, name)


class _OneThread(Executor):
    """Executor in a simulation, with a thread per task that waits for the previous task."""

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
