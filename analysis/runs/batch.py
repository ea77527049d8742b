"""`each`: apply a function to items in this process, in several processes, or on a Dask cluster, with equal results.

The cluster must be running already. The scheduler reassigns the items of a dead worker. Workers see the same files
under the same paths and have the same versions of numerical packages, so the results equal local results.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import CancelledError
from functools import partial
from importlib import metadata
from itertools import islice
from typing import Any

from analysis.runs.processes import FailedItem, Item, Outcome, Value, attempt, cores, in_processes
from analysis.runs.remote import RemotePath, fetching_into, place_of_copies
from rigs.distribution import NAME, to_install
from rigs.errors import CellError, FileError


def each(
    work: Callable[[Item], Value], items: Sequence[Item], *, jobs: int = 1, scheduler: str | None = None
) -> Generator[Outcome[Item, Value], None, None]:
    """Outcome for each item in order, as soon as the outcome and all previous outcomes are available.

    work: a stateless module-level function, importable by other processes. A RigError or a numerical error becomes the
    outcome of the item; other exceptions are bugs and are raised here. items, values: picklable. jobs: number of local
    processes; 0 for one per core. scheduler: address of a Dask scheduler to use instead.

    Remote runs are always fetched by separate processes: store packages start threads, and a process waiting for a
    store can be ended immediately.

    If a process is killed, for example by the out-of-memory killer, the item is repeated once and then fails. Closing
    the iteration, as after Ctrl-C, kills the processes.
    """
    if scheduler is not None:
        return on_cluster(work, items, scheduler)
    if any(isinstance(item, RemotePath) for item in items):
        return _fetched_by_processes(work, items, jobs)
    if jobs != 1 and len(items) > 1:
        return in_processes(work, items, min(jobs or cores(), len(items)))
    return (attempt(work, item) for item in items)


def _fetched_by_processes(
    work: Callable[[Item], Value], items: Sequence[Item], jobs: int
) -> Generator[Outcome[Item, Value], None, None]:
    with place_of_copies() as place:
        yield from in_processes(partial(fetching_into, place, work), items, min(jobs or cores(), len(items)))


_AHEAD = 1000
"""Number of items submitted to the cluster ahead of the expected item: more than the threads of a cluster."""
_CONNECTED_S = 10
_COMPUTING = (NAME, "numpy", "scipy")
"""Packages with an influence on the last digits of a result."""


def on_cluster(
    work: Callable[[Item], Value], items: Sequence[Item], address: str
) -> Generator[Outcome[Item, Value], None, None]:
    """Outcomes in order of the items. Items that have not started are cancelled at the end of the iteration.

    Raises FileError if dask.distributed is not installed, and CellError for a cluster that does not respond, has no
    workers, or has different versions.
    """
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
        raise CellError(f"--scheduler {address}", problem, remedy, code="cluster.silent") from None


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
                code="cluster.no_workers",
            )
        for worker, version in theirs.items():
            if version != ours:
                has = f"has {package} {version}" if isinstance(version, str) else f"lacks {package}"
                raise CellError(
                    str(worker),
                    f"{has}, but this computer {ours}",
                    "install the same version on both",
                    code="cluster.versions",
                )


def _result(future: Any, item: Item, address: str) -> Outcome[Item, Any]:
    from distributed import KilledWorker  # noqa: PLC0415

    try:
        outcome: Outcome[Item, Any] = future.result()
    except KilledWorker:
        remedy = "it may need more memory than a worker has: give the workers more, or work on it here"
        problem = "all workers that processed this run died"
        return FailedItem(item, CellError(str(item), problem, remedy, code="cluster.worker_died"))
    except (CancelledError, OSError) as error:
        problem = f"the connection to the Dask scheduler was lost: {type(error).__name__}"
        remedy = "start the scheduler, then repeat the command"
        raise CellError(address, problem, remedy, code="cluster.lost") from None
    return outcome
