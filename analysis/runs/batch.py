"""Work on runs: in this process, in several processes, or on a Dask cluster, with equal results.

A local process has one item at a time, so the item is known if the process is killed; `concurrent.futures` abandons all
work in that case. This process has no threads, because a fork could copy a thread in the middle of an operation.

Workers of a cluster see the same files under the same paths and have the same versions of numerical packages.
"""

from __future__ import annotations

import logging
import multiprocessing as mp
import os
import signal
import sys
import traceback
import warnings
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib import metadata
from itertools import islice
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Generic, TypeVar

from analysis.runs.copied_runs import CopiedRun
from daq.store.manifest import is_run as is_run_directory
from rigs.distribution import NAME, to_install
from rigs.errors import CellError, FileError, RigError, UseError

Item = TypeVar("Item")
Value = TypeVar("Value")
NO_RUNS = "lost+found"
"""A directory at the top of a file system with access for root only."""
_REMEDY = "check those in the rig file and in the readings"


@dataclass(frozen=True)
class CompletedItem(Generic[Item, Value]):
    """An item with its value, and the number of processes killed before while working on it."""

    item: Item
    value: Value
    deaths: int = 0


@dataclass(frozen=True)
class FailedItem(Generic[Item]):
    """An item with its error, and the number of processes killed while working on it."""

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
        failure = CellError(str(item), "not enough memory for this run", remedy, code="computer.unsuitable")
    except (ArithmeticError, ValueError, RuntimeWarning) as error:
        if not is_numerical(error):
            raise
        failure = FileError(str(item), f"the computation failed: {error}", _REMEDY, code="readings.unsuitable")
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
    """A process, the connection to it, and the index of its item."""

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
        code="computer.unsuitable",
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


def each(
    work: Callable[[Item], Value], items: Sequence[Item], *, jobs: int = 1, scheduler: str | None = None
) -> Generator[Outcome[Item, Value], None, None]:
    """Outcome for each item in order, as soon as it and all previous outcomes are available.

    work: a stateless module-level function. items, values: picklable. jobs: local processes; 0 for one per core.
    scheduler: address of a Dask scheduler to use instead. Exceptions other than a RigError or a numerical error are
    bugs and are raised here.

    If a process is killed, for example by the out-of-memory killer, the item is repeated once and then fails. Closing
    the iteration, as after Ctrl-C, kills the processes.
    """
    if scheduler is not None:
        return on_cluster(work, items, scheduler)
    if jobs != 1 and len(items) > 1:
        return in_processes(work, items, min(jobs or cores(), len(items)))
    return (attempt(work, item) for item in items)


_AHEAD = 1000
"""Number of items submitted to the cluster ahead of the expected item: more than the threads of a cluster."""
_CONNECTED_S = 10
_COMPUTING = (NAME, "numpy", "scipy")
"""Packages with an influence on the last digits of a result."""


def on_cluster(
    work: Callable[[Item], Value], items: Sequence[Item], address: str
) -> Generator[Outcome[Item, Value], None, None]:
    """Outcomes in order of the items. Items that have not started are cancelled at the end.

    Raises FileError if dask.distributed is not installed, and CellError for a cluster that does not respond, has no
    workers, or has different versions.
    """
    require_shared(items, address)
    client = _connected(address)
    try:
        _require_same_versions(client, address)
        todo = iter(items)
        waiting = deque((item, client.submit(attempt, work, item, pure=False)) for item in islice(todo, _AHEAD))
        while waiting:
            item, future = waiting.popleft()
            result = _result(future, item, address)
            future.release()
            waiting.extend(
                (following, client.submit(attempt, work, following, pure=False)) for following in islice(todo, 1)
            )
            yield result
    finally:
        client.close()


def require_shared(items: Iterable[object], scheduler: str | None) -> None:
    if scheduler and (copied := next((item for item in items if isinstance(item, CopiedRun)), None)):
        problem = "is copied to this computer, where the workers of a cluster cannot read it"
        raise UseError(str(copied), problem, "copy the runs to a directory that all computers share")


def _connected(address: str) -> Any:
    import asyncio  # noqa: PLC0415 - takes 10 ms, and only a cluster needs it

    try:
        from distributed import Client  # noqa: PLC0415 - an extra
    except ModuleNotFoundError:
        problem = "needs the Python package dask.distributed, which is not installed"
        raise FileError("--scheduler", problem, to_install("distributed"), code="package.missing") from None
    # The log of a lost connection would appear among the results. Relevant errors are raised here.
    for logger in ("distributed", "distributed.client"):
        logging.getLogger(logger).setLevel(logging.CRITICAL)
    try:
        # A client of a missing scheduler takes long to close, even after Ctrl-C.
        asyncio.run(asyncio.wait_for(_query_scheduler(address), _CONNECTED_S))
        return Client(address, timeout=_CONNECTED_S, set_as_default=False)
    # MemoryError: other programs may announce any message size
    except (MemoryError, OSError, TypeError, ValueError) as error:
        problem = f"the Dask scheduler does not answer: {str(error) or f'nothing came within {_CONNECTED_S} s'}"
        remedy = "give the address printed by the scheduler, such as tcp://10.0.0.5:8786"
        raise CellError(f"--scheduler {address}", problem, remedy, code="port.silent") from None


async def _query_scheduler(address: str) -> None:
    from distributed import Security  # noqa: PLC0415
    from distributed.core import rpc  # noqa: PLC0415

    async with rpc(address, connection_args=Security().get_connection_args("client")) as scheduler:
        await scheduler.identity()


def _require_same_versions(client: Any, address: str) -> None:
    for package in _COMPUTING:
        ours = metadata.version(package)
        theirs = client.run(metadata.version, package, on_error="return")
        if not theirs:
            raise CellError(
                address,
                "has no workers",
                f"start a worker: dask worker {address} --nthreads 1",
                code="process.failed",
            )
        for worker, version in theirs.items():
            if version != ours:
                has = f"has {package} {version}" if isinstance(version, str) else f"lacks {package}"
                raise CellError(
                    str(worker),
                    f"{has}, but this computer {ours}",
                    "install the same version on both",
                    code="package.missing",
                )


def _result(future: Any, item: Item, address: str) -> Outcome[Item, Any]:
    from distributed import KilledWorker  # noqa: PLC0415

    try:
        outcome: Outcome[Item, Any] = future.result()
    except KilledWorker:
        remedy = "it may need more memory than a worker has: give the workers more, or work on it here"
        problem = "all workers that processed this run died"
        return FailedItem(item, CellError(str(item), problem, remedy, code="process.failed"))
    except (CancelledError, OSError) as error:
        problem = f"the connection to the Dask scheduler was lost: {type(error).__name__}"
        remedy = "start the scheduler, then repeat the command"
        raise CellError(address, problem, remedy, code="process.failed") from None
    return outcome


def run_directories(paths: Iterable[Path]) -> list[Path]:
    """Runs at or below paths, sorted by name within a directory. A run that a directory links again counts once.

    A path without runs is returned unchanged, and reading it then reports the problem. Raises FileError if two paths
    lead to the same run.
    """
    runs: dict[Path, Path] = {}
    for path in paths:
        top = path.run if isinstance(path, CopiedRun) else path
        below = [] if _is_run(top) else list(_runs_below(top))
        here: dict[Path, Path] = {}
        for run in below:
            named = CopiedRun.of(f"{path}/{run.relative_to(top)}", run) if isinstance(path, CopiedRun) else run
            here.setdefault(run.resolve(), named)
        if not below:
            here[top.resolve()] = path
        _refuse_repeated_paths(runs, here)
        runs |= here
    return list(runs.values())


def distinct(paths: Iterable[Path]) -> list[Path]:
    """Resolved paths. Raises FileError if two lead to the same file or directory."""
    given: dict[Path, Path] = {}
    for path in paths:
        here = {path.resolve(): path}
        _refuse_repeated_paths(given, here)
        given |= here
    return list(given)


def _refuse_repeated_paths(earlier: Mapping[Path, Path], here: Mapping[Path, Path]) -> None:
    for resolved, path in here.items():
        if first := earlier.get(resolved):
            also = "" if path == first else f", also as {first}"
            raise FileError(str(path), f"is given twice{also}", "give it once", code="run.copied")


def _runs_below(top: Path) -> Iterator[Path]:
    """Runs below a directory. Each directory is entered once, even if several links lead to it.

    An unreadable directory is returned like a run, because it may contain runs.
    """
    entered: set[tuple[int, int]] = set()
    todo = [top]
    while todo:
        folder = todo.pop()
        if folder != top and _is_run(folder):
            yield folder
            continue
        try:
            status = folder.stat()
            identity = (status.st_dev, status.st_ino)
            below = (
                sorted(entry for entry in folder.iterdir() if not entry.name.startswith(".") and entry.is_dir())
                if identity not in entered
                else []
            )
        except NotADirectoryError:
            continue
        except OSError:
            if folder.name != NO_RUNS:
                yield folder
            continue
        entered.add(identity)
        todo += reversed(below)


def _is_run(path: Path) -> bool:
    try:
        return is_run_directory(path)
    except OSError:
        return False
