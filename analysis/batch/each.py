"""`each`: a function over many items, wherever it runs; what it gives does not depend on that."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from functools import partial

from analysis.batch.fetched import fetching_into, place_of_copies
from analysis.batch.outcomes import Item, Outcome, Value, attempt, outcome_of
from analysis.batch.remote_path import RemotePath


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
        from analysis.batch.dask_cluster import on_cluster  # noqa: PLC0415 - an extra

        yield from on_cluster(work, items, scheduler)
        return
    if any(isinstance(item, RemotePath) for item in items):
        from analysis.batch.processes import cores, in_processes  # noqa: PLC0415

        with place_of_copies() as place:
            yield from in_processes(partial(fetching_into, place, work), items, min(jobs or cores(), len(items)))
        return
    if (jobs == 0 or jobs > 1) and len(items) > 1:
        from analysis.batch.processes import cores, in_processes  # noqa: PLC0415 - not for a single run

        yield from in_processes(work, items, min(jobs or cores(), len(items)))
        return
    for item in items:
        yield outcome_of(item, attempt(work, item))
