"""`each`: a function over many items, in this process, in several, or on the workers of a Dask cluster; what it gives
does not depend on that.

Somebody else started the cluster: nothing here listens. Its scheduler gives what a dead worker had to another one.
Workers find the same files under the same paths, and have the same versions of what computes, so that their results are
those of this computer.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from functools import partial
from importlib import metadata
from itertools import islice
from typing import Any

from analysis.runs.batch.fetched import fetching_into, place_of_copies
from analysis.runs.batch.outcomes import Item, Outcome, Value, attempt, outcome_of
from analysis.runs.batch.remote_path import RemotePath
from rigs.distribution import NAME, to_install
from rigs.errors import CellError, FileError


def each(
    work: Callable[[Item], Value], items: Sequence[Item], *, jobs: int = 1, scheduler: str | None = None
) -> Generator[Outcome[Item, Value], None, None]:
    """The outcome of the work for each item, in the order of the items, each as soon as those before it are there.

    work: at the top of a module, without a state of its own, so that other processes find it; what it raises as a
    RigError, or for its numbers, is the outcome of that item. Any other exception is a bug and is raised here.
    items, values: of types that can be pickled.
    jobs: processes of this machine; 0 for one on each core.
    scheduler: the address of a Dask scheduler, whose workers do the work instead.

    Runs that lie elsewhere are fetched by processes of their own, however few: the packages of stores start threads,
    and a process that waits for a store is ended at once.

    A process that is killed, as by a system out of memory, costs time: its item is begun once more, and fails where
    that is killed as well. Where the iteration is closed, as after Ctrl-C, the processes are killed.
    """
    if scheduler is not None:
        yield from on_cluster(work, items, scheduler)
        return
    if any(isinstance(item, RemotePath) for item in items):
        from analysis.runs.batch.processes import cores, in_processes  # noqa: PLC0415

        with place_of_copies() as place:
            yield from in_processes(partial(fetching_into, place, work), items, min(jobs or cores(), len(items)))
        return
    if (jobs == 0 or jobs > 1) and len(items) > 1:
        from analysis.runs.batch.processes import cores, in_processes  # noqa: PLC0415 - not for a single run

        yield from in_processes(work, items, min(jobs or cores(), len(items)))
        return
    for item in items:
        yield outcome_of(item, attempt(work, item))


_AHEAD = 1000
"""Items given to the cluster beyond the one that is waited for: more than a cluster has threads."""
_CONNECTED_S = 10
_COMPUTING = (NAME, "numpy", "scipy")
"""Packages whose versions decide about the digits of a result."""


def on_cluster(work: Callable[[Item], Value], items: Sequence[Item], address: str) -> Iterator[Outcome[Item, Value]]:
    """The outcomes in the order of the items. What no worker has begun is cancelled when the iteration ends.

    Raises FileError where dask.distributed is not installed, CellError for a cluster that does not answer, has no
    workers, or other versions.
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
            yield outcome_of(item, result)
    finally:
        client.close()


def _connected(address: str) -> Any:
    try:
        from distributed import Client  # noqa: PLC0415 - an extra
    except ModuleNotFoundError:
        problem = "needs dask.distributed, which is not installed"
        raise FileError("--scheduler", problem, to_install("distributed")) from None
    # What it logs of a lost connection would stand among the results; what matters of it is raised here.
    for logger in ("distributed", "distributed.client"):
        logging.getLogger(logger).setLevel(logging.CRITICAL)
    try:
        # A client that is made where no scheduler is waits long for its own end, after Ctrl-C as well.
        asyncio.run(asyncio.wait_for(_asked(address), _CONNECTED_S))
        return Client(address, timeout=_CONNECTED_S, set_as_default=False)
    except (MemoryError, OSError, TypeError, ValueError) as error:  # of memory: what is no scheduler names any size
        problem = f"no Dask scheduler answers: {str(error) or f'nothing came within {_CONNECTED_S} s'}"
        remedy = "give the address that it printed, as tcp://10.0.0.5:8786"
        raise CellError(f"--scheduler {address}", problem, remedy) from None


async def _asked(address: str) -> None:
    """Ask a scheduler who it is. Raises what distributed raises where none answers."""
    from distributed import Security  # noqa: PLC0415
    from distributed.core import rpc  # noqa: PLC0415

    async with rpc(address, connection_args=Security().get_connection_args("client")) as scheduler:
        await scheduler.identity()


def _require_same_versions(client: Any, address: str) -> None:
    """Raises CellError unless there are workers, all of which compute as this computer does."""
    for package in _COMPUTING:
        ours = metadata.version(package)
        theirs = client.run(metadata.version, package, on_error="return")
        if not theirs:
            raise CellError(address, "has no workers", f"start one: dask worker {address} --nthreads 1")
        for worker, version in theirs.items():
            if version != ours:
                has = f"has {package} {version}" if isinstance(version, str) else f"lacks {package}"
                raise CellError(str(worker), f"{has}, and this computer {ours}", "install the same version on both")


def _result(future: Any, item: object, address: str) -> Any:
    """What `attempt` returned on a worker, or the error of an item over which workers died."""
    from distributed import KilledWorker  # noqa: PLC0415

    try:
        return future.result()
    except KilledWorker:
        remedy = "it may need more memory than a worker has: give the workers more, or work on it here"
        return CellError(str(item), "the workers that worked on it died, one after another", remedy)
    except (CancelledError, OSError) as error:
        raise CellError(
            address, f"the Dask scheduler is gone: {type(error).__name__}", "start it and this command again"
        ) from None
