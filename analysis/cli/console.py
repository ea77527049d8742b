"""Output to the terminal: lines, JSON and progress. All text is made plain (`rigs.text`).

Progress appears only on a terminal. Tables: `PlainConsole`.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import typer

from rigs.errors import RigError
from rigs.signals import COMPLETED, REPLACED
from rigs.text import escape_text


def say(line: object, *, err: bool = False, mark: str = "") -> None:
    """Print a line. mark: text of the program before the line, which may contain colours."""
    typer.echo(mark + escape_text(str(line)), err=err)


def say_written(paths: Iterable[Path]) -> None:
    """Report the written files on standard error, and which of them replaced an earlier one."""
    for path in paths:
        say(f"wrote {path}{', replacing the earlier file' * (path in REPLACED)}", err=True)


def say_error(error: RigError) -> None:
    """Print an error on standard error: a line for each mistake, with `--json` one JSON object in a line."""
    if "--json" in sys.argv[1:]:
        say(json.dumps({"error": error.to_dict()}), err=True)
        return
    for line in error.lines():
        say(f"error: {line}", err=True)


INTERRUPTED = 130
"""Exit code expected by a shell for a program ended by Ctrl-C."""
_MOST_WRITTEN = 3


def say_interrupted() -> None:
    hidden, temporary = f".tmp{os.sep}", f"{tempfile.gettempdir()}{os.sep}rig-"
    paths = [path for path in dict.fromkeys(map(str, COMPLETED)) if not path.startswith(temporary)]
    paths = [path for path in paths if hidden not in path and os.path.lexists(path)]
    shown = [*paths[:_MOST_WRITTEN], *([f"{len(paths) - _MOST_WRITTEN} more"] if len(paths) > _MOST_WRITTEN else [])]
    say(f"interrupted; {'complete: ' + ', '.join(shown) if paths else 'nothing was written'}", err=True)


def say_json(value: Any) -> None:
    """Print a value (see `for_json`) without control characters: the encoder escapes all except DEL."""
    from analysis.runs.tabular import for_json

    typer.echo(json.dumps(for_json(value), indent=2).replace("\x7f", "\\u007f"))


_SILENT_S, _STEP_S = 1.0, 0.1
"""Delay before counted progress is shown, and interval of updates."""


@contextmanager
def progress_of(doing: str = "reading the runs", *, is_still: bool = False) -> Iterator[Callable[[str], None]]:
    """Show the current step on a terminal, and yield a function to change it. Other output would share its line.

    is_still: show a line without a timer, for processes that are forked meanwhile and must not inherit the thread and
    the locks of a live display.
    """
    if not sys.stderr.isatty():
        yield lambda doing: None
        return
    if is_still:
        rewrite_line(doing)
        try:
            yield rewrite_line
        finally:
            rewrite_line("")
        return
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    from analysis.cli.plain_console import PlainConsole

    words = TextColumn("{task.description}", markup=False)
    # Redirection would also send output for files to the terminal.
    with Progress(
        SpinnerColumn(),
        words,
        TimeElapsedColumn(),
        console=PlainConsole(stderr=True),
        transient=True,
        redirect_stdout=False,
    ) as shown:
        task = shown.add_task(escape_text(doing), total=None)
        yield lambda doing: shown.update(task, description=escape_text(doing))


def rewrite_line(words: str) -> None:
    """Replace the current line of the terminal by a text, cut to the width."""
    shown = escape_text(words)[: shutil.get_terminal_size().columns - 1]
    sys.stderr.write(f"\r\x1b[K{shown}")
    sys.stderr.flush()


class CountedProgress:
    """Counter of completed items on a terminal for forked processes, shown after a second; Ctrl-C reports the count."""

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
