"""Work in several processes of this machine, each with one item at a time.

One item at a time, since then it is known which item a process died over: `concurrent.futures` gives up all its work
where the system kills one process. No thread runs here, so that a fork copies none in the middle of something.
"""

from __future__ import annotations

import multiprocessing as mp
import os
import signal
import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any

from analysis.runs.batch.outcomes import Failed, Item, Outcome, Value, attempt, outcome_of
from rigs.errors import CellError

_CONTEXT = mp.get_context("fork") if sys.platform == "linux" else mp.get_context("spawn")
"""A fork has everything imported; elsewhere than on Linux it is not safe, or does not exist."""
_TRIES = 2
"""An item is begun once more where its process is killed: the system may have taken the wrong one for its memory."""

_SIGNALS_S = 1.0
"""How long one wait lasts: Python looks for a Ctrl-C between calls, so one that comes just before a wait would wait as
long as the work does (seen once in a thousand runs of the tests on a busy computer)."""

_AHEAD = 200
"""Items begun beyond the one that is waited for: their values lie in memory until it is there."""


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass
class _Worker:
    """A process and the line to it; place: of the item that it works on."""

    process: BaseProcess
    line: Connection[Any, Any]
    place: int | None = None


def in_processes(
    work: Callable[[Item], Value], items: Sequence[Item], processes: int
) -> Iterator[Outcome[Item, Value]]:
    """The outcomes in the order of the items. All processes are gone when the iteration ends, however it ends."""
    todo = list(range(len(items)))[::-1]
    deaths = [0] * len(items)
    outcomes: dict[int, Outcome[Item, Value]] = {}
    workers: list[_Worker] = []
    try:
        for following in range(len(items)):
            while following not in outcomes:
                _keep_busy(workers, work, items, todo, (processes, following + _AHEAD))
                for worker in _heard(workers):
                    place, worker.place = worker.place, None
                    assert place is not None  # noqa: S101 - only those at work are listened to
                    try:
                        # What the work gave. Raises EOFError where the process has died, and the bug that it ran into
                        is_bug, answer = worker.line.recv()
                        if is_bug:
                            raise answer
                        outcomes[place] = outcome_of(items[place], answer, deaths[place])
                    except (EOFError, ConnectionError):
                        workers.remove(worker)
                        _bury(worker)
                        deaths[place] += 1
                        if deaths[place] < _TRIES:
                            todo.append(place)
                        else:
                            outcomes[place] = Failed(items[place], _killed(items[place], worker.process), deaths[place])
            yield outcomes.pop(following)
    finally:
        for worker in workers:
            _bury(worker)


def _keep_busy(
    workers: list[_Worker],
    work: Callable[[Item], Value],
    items: Sequence[Item],
    todo: list[int],
    most: tuple[int, int],
) -> None:
    """Give an item to each worker that has none, and start workers; most: how many, and the place not yet to begin."""
    processes, end = most
    while todo and todo[-1] < end:
        idle = next((worker for worker in workers if worker.place is None), None)
        if idle is not None and not idle.process.is_alive():  # killed while it waited: no item's fault
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
        with suppress(ConnectionError):  # it has died since, which is heard next
            idle.line.send(items[idle.place])


def _heard(workers: Sequence[_Worker]) -> list[_Worker]:
    """Those at work that have answered or died; waits for the first."""
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
        f"the process that worked on it {how}, {_TRIES} times",
        "it may need more memory than there is: close other programs, or give fewer --jobs",
    )


def _serve(work: Callable[[Any], Any], line: Connection[Any, Any]) -> None:
    """Work on the items that come, until the parent is gone. It decides about Ctrl-C, which reaches every process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = mp.parent_process()
    assert parent is not None  # noqa: S101 - this is a child
    with suppress(EOFError, ConnectionError):
        # Forked later, other workers hold copies of the parent's end, so that its death does not end the line.
        while parent.sentinel not in wait([line, parent.sentinel]):
            item = line.recv()
            try:
                answer = (False, attempt(work, item))
            except Exception as bug:  # noqa: BLE001 - the parent raises it
                bug.add_note(traceback.format_exc())
                answer = (True, bug)
            line.send(answer)
