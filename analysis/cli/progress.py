"""What is being done, shown on a terminal while it takes long, and nowhere else."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def progress_of(*, quiet: bool = False) -> Iterator[Callable[[str], None]]:
    """What to call with what is being done."""
    from analysis.reporting.plain_console import PlainConsole  # noqa: PLC0415

    console = PlainConsole(stderr=True)
    if quiet or not console.is_terminal:
        yield lambda doing: None
        return
    with console.status("reading the runs") as status:
        yield status.update
