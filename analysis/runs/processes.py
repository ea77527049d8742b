"""Work on items in several local processes, each with one item at a time, and the outcome of an item.

If a process is killed, the item is therefore known; `concurrent.futures` abandons all work in that case. This process
has no threads, because a fork could copy a thread in the middle of an operation.
"""

from __future__ import annotations

import multiprocessing as mp
import os
import signal
import sys
import traceback
import warnings
from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, Generic, TypeVar

from rigs.errors import CellError, FileError, RigError

Item = TypeVar("Item")
Value = TypeVar("Value")
_REMEDY = "check those in the rig file and in the readings"


@dataclass(frozen=True)
class CompletedItem(Generic[Item, Value]):
    """An item with a value. deaths: number of processes killed before while working on it."""

    item: Item
    value: Value
    deaths: int = 0


@dataclass(frozen=True)
class FailedItem(Generic[Item]):
    """An item with an error. deaths: number of processes killed while working on it."""

    item: Item
    error: RigError
    deaths: int = 0


Outcome = CompletedItem[Item, Value] | FailedItem[Item]


def attempt(work: Callable[[Item], Value], item: Item) -> Outcome[Item, Value]:
    """Do the work for an item. Exceptions that no run causes are bugs and are raised.

    A RuntimeWarning is an error here in every process: numpy warns only if a figure becomes NaN.
    """
    failure: RigError
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            return CompletedItem(item, work(item))
    except RigError as error:
        failure = error
    except MemoryError:
        remedy = "close other programs, or give fewer --jobs"
        failure = CellError(str(item), "not enough memory for this run", remedy, code="computer.memory")
    except (ArithmeticError, ValueError, RuntimeWarning) as error:
        if not is_numerical(error):
            raise
        failure = FileError(str(item), f"the computation failed: {error}", _REMEDY, code="run.numerical")
    return FailedItem(item, failure)


def is_numerical(error: BaseException) -> bool:
    """True if a computation failed numerically: overflow, NaN, or an error of a solver in numpy or scipy."""
    if isinstance(error, ArithmeticError | RuntimeWarning) or type(error).__name__ == "LinAlgError":
        return True
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return trace is not None and str(trace.tb_frame.f_globals.get("__name__")).startswith("scipy.")


_CONTEXT = mp.get_context("fork") if sys.platform == "linux" else mp.get_context("spawn")
"""A fork has all modules imported already. Outside Linux it is unsafe or missing."""
_TRIES = 2
"""Attempts per item after a killed process: the out-of-memory killer may have chosen the wrong process."""

_SIGNALS_S = 1.0
"""Longest wait in seconds. Python handles Ctrl-C only between calls, so a Ctrl-C just before a long wait would be
delayed.

This was seen once in a thousand test runs on a busy computer.
"""

_STARTED_AHEAD = 200
"""Number of items started ahead of the expected item; the values stay in memory."""


def cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass
class _Worker:
    """A process and the connection to it. place: index of the current item."""

    process: BaseProcess
    line: Connection[Any, Any]
    place: int | None = None


def in_processes(
    work: Callable[[Item], Value], items: Sequence[Item], processes: int
) -> Generator[Outcome[Item, Value], None, None]:
    """Outcomes in order of the items. All processes are gone at the end of the iteration."""
    todo = list(range(len(items)))[::-1]
    deaths = [0] * len(items)
    outcomes: dict[int, Outcome[Item, Value]] = {}
    workers: list[_Worker] = []
    try:
        for following in range(len(items)):
            while following not in outcomes:
                _keep_busy(workers, work, items, todo, (processes, following + _STARTED_AHEAD))
                for worker in _heard(workers):
                    place, worker.place = worker.place, None
                    assert place is not None  # noqa: S101 - only those at work are listened to
                    try:
                        # The result of the work. Raises EOFError if the process has died, and exceptions caused by
                        # bugs.
                        is_bug, answer = worker.line.recv()
                        if is_bug:
                            raise answer
                        outcomes[place] = replace(answer, item=items[place], deaths=deaths[place])
                    except (EOFError, ConnectionError):
                        workers.remove(worker)
                        _bury(worker)
                        deaths[place] += 1
                        if deaths[place] < _TRIES:
                            todo.append(place)
                        else:
                            outcomes[place] = FailedItem(
                                items[place], _killed(items[place], worker.process), deaths[place]
                            )
            yield outcomes.pop(following)
    finally:
        for worker in workers:
            _bury(worker)


def _keep_busy(
    workers: list[_Worker], work: Callable[[Item], Value], items: Sequence[Item], todo: list[int], most: tuple[int, int]
) -> None:
    """Give an item to each idle worker, and start workers.

    most: maximum number of workers, and the first index that must not start yet.
    """
    processes, end = most
    while todo and todo[-1] < end:
        idle = next((worker for worker in workers if worker.place is None), None)
        if idle is not None and not idle.process.is_alive():  # It was killed while idle, independent of any item.
            workers.remove(idle)
            _bury(idle)
            continue
        if idle is None:
            if len(workers) >= processes:
                return
            ours, theirs = _CONTEXT.Pipe()
            process = _CONTEXT.Process(target=_serve, args=(work, theirs), daemon=True)
            process.start()
            theirs.close()
            idle = _Worker(process, ours)
            workers.append(idle)
        idle.place = todo.pop()
        with suppress(ConnectionError):  # If it has died in the meantime, this is detected next.
            idle.line.send(items[idle.place])


def _heard(workers: Sequence[_Worker]) -> list[_Worker]:
    at_work = [worker.line for worker in workers if worker.place is not None]
    while not (lines := wait(at_work, _SIGNALS_S)):
        pass
    return [worker for worker in workers if worker.line in lines]


def _bury(worker: _Worker) -> None:
    worker.process.kill()
    worker.process.join()
    worker.line.close()


def _killed(item: object, process: BaseProcess) -> CellError:
    code = process.exitcode or 0
    how = f"was killed by signal {-code}" if code < 0 else f"ended with code {code}"
    return CellError(
        str(item),
        f"the process for this run {how}, {_TRIES} times",
        "the memory may be too small: close other programs, or give fewer --jobs",
        code="computer.memory",
    )


def _serve(work: Callable[[Any], Any], line: Connection[Any, Any]) -> None:
    """Process items until the parent has ended. The parent handles Ctrl-C, which reaches every process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = mp.parent_process()
    assert parent is not None  # noqa: S101 - this is a child
    with suppress(EOFError, ConnectionError):
        # Later workers inherit the end of the parent, so the death of the parent does not close the connection.
        while parent.sentinel not in wait([line, parent.sentinel]):
            item = line.recv()
            answer: tuple[bool, Any]
            try:
                answer = (False, attempt(work, item))
            except Exception as bug:  # noqa: BLE001 - the parent raises it
                bug.add_note(traceback.format_exc())
                answer = (True, bug)
            line.send(answer)
