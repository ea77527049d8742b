"""Work on the workers of a Dask cluster, which somebody else started: nothing here listens.

The scheduler gives what a dead worker had to another one. Workers find the same files under the same paths, and have
the same versions of what computes, so that their results are those of this computer.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from importlib import metadata
from itertools import islice
from typing import Any

from analysis.batch.outcomes import Item, Outcome, Value, attempt, outcome_of
from rigs.distribution import NAME, to_install
from rigs.errors import CellError, FileError

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
