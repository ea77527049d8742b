"""What is being done and for how long, shown on a terminal while it takes, and nowhere else."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rigs.text import plain


@contextmanager
def progress_of(doing: str = "reading the runs", *, is_still: bool = False) -> Iterator[Callable[[str], None]]:
    """Show what is being done on standard error; give the function to call when something else is.

    is_still: as a line without seconds, where processes are forked meanwhile: they must not inherit the thread and the
    locks of a moving display. Nothing is shown where standard error is no terminal. Everything else is printed after
    it: within, it would stand on the same line.
    """
    if not sys.stderr.isatty():
        yield lambda doing: None
        return
    if is_still:
        _rewrite_line(doing)
        try:
            yield _rewrite_line
        finally:
            _rewrite_line("")
        return
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn  # noqa: PLC0415

    from analysis.reporting.plain_console import PlainConsole  # noqa: PLC0415

    words = TextColumn("{task.description}", markup=False)
    # Redirected, what is printed to a file within would land on the terminal.
    with Progress(
        SpinnerColumn(),
        words,
        TimeElapsedColumn(),
        console=PlainConsole(stderr=True),
        transient=True,
        redirect_stdout=False,
    ) as shown:
        task = shown.add_task(plain(doing), total=None)
        yield lambda doing: shown.update(task, description=plain(doing))


def _rewrite_line(words: str) -> None:
    """Put words in place of the line where the cursor stands, as far as the terminal is wide."""
    shown = plain(words)[: shutil.get_terminal_size().columns - 1]
    sys.stderr.write(f"\r\x1b[K{shown}")
    sys.stderr.flush()
