"""The way to a person's terminal: lines and JSON, all text in them plain (`rigs.text`). Tables: `PlainConsole`."""

from __future__ import annotations

import json
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
