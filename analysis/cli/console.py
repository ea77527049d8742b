"""The way to a person's terminal: lines and JSON, all text in them plain (`rigs.text`), and what is being done and for
how long, shown on a terminal while it takes, and nowhere else. Tables: `PlainConsole`."""

from __future__ import annotations

import json
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import typer

from rigs.errors import RigError
from rigs.text import plain


def say(line: object, *, err: bool = False, mark: str = "") -> None:
    """Print one line. mark: the program's own words before it, which may be coloured."""
    typer.echo(mark + plain(str(line)), err=err)


def say_error(error: RigError) -> None:
    """Print an error on standard error, one line for each mistake."""
    for line in error.lines():
        say(f"error: {line}", err=True)


def say_json(value: Any) -> None:
    """Print JSON. Its encoder escapes what is below a space or beyond ASCII; DEL alone is left to escape here."""
    typer.echo(json.dumps(value, indent=2).replace("\x7f", "\\u007f"))


_SILENT_S, _STEP_S = 1.0, 0.1
"""Nothing is shown of counted work that takes no longer, and then a line so often."""


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
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    from analysis.report.plain_console import PlainConsole

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


class CountedProgress:
    """What is done of how much, on a terminal, once it takes longer than a second; after Ctrl-C how far it got.

    Not `progress_of`: work goes on in forked processes, which must not inherit a display's thread and locks.
    """

    def __init__(self) -> None:
        self._began_s = self._shown_s = time.monotonic()
        self._last = ("", "")

    def __call__(self, doing: str, done: int, total: int) -> None:
        self._last = (doing, f"{done} of {total}")
        now_s = time.monotonic()
        if not sys.stderr.isatty() or now_s - self._began_s < _SILENT_S:
            return
        if done == total or now_s - self._shown_s >= _STEP_S:
            self._shown_s = now_s
            typer.echo(f"\r{doing}: {done} of {total}\x1b[K", err=True, nl=done == total)

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        doing, count = self._last
        if kind is KeyboardInterrupt and doing:
            start = "\r\x1b[K" if sys.stderr.isatty() else ""
            say(f"interrupted while {doing}: {count} are kept; repeat the command to continue", err=True, mark=start)
