"""The command `rig`. Each command is a file; everything heavy is imported inside it, so that help is quick."""

from __future__ import annotations

import errno
import io
import os
import sys
from typing import Annotated

import typer

from rigs.errors import CellError, RigError

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
_OF_A_CELL = ("fcntl", "grp", "termios", "tty")
"""Modules that Windows lacks: serial lines, and the socket of a running daemon."""

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Robot metrology with a ball link and two digital probes: record, analyse, compare.",
)


def main() -> None:
    """Entry point: every expected failure is one line and an exit code."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        # A file's name may be no UTF-8, and a terminal may know no φ: neither is a reason to say nothing.
        sys.stdout.reconfigure(errors="surrogateescape" if sys.stdout.encoding == "utf-8" else "replace")
    try:
        app()
    except RigError as error:
        sys.exit(_refused(error))
    except ModuleNotFoundError as error:
        if error.name not in _OF_A_CELL:
            raise
        command = " ".join(["rig", *sys.argv[1:2]])
        remedy = "run it on the computer of the cell; saved runs are analysed here"
        sys.exit(_refused(CellError(command, f"needs Linux: this system lacks {error.name}", remedy)))
    except BrokenPipeError:
        sys.exit(0)
    except OSError as error:
        if error.errno not in _NO_ROOM or error.filename is not None:
            raise
        full = CellError("output", error.strerror or str(error), "free some space, or write it elsewhere")
        code = _refused(full)
        # What is left in the buffer would fail once more at the end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(code)


def _refused(error: RigError) -> int:
    """Print an error for a person, and return its exit code."""
    sys.stderr.writelines(f"error: {line}\n" for line in error.lines())
    return error.exit_code


def _version(asked: bool) -> None:
    if asked:
        from importlib import metadata  # noqa: PLC0415

        typer.echo(f"rig {metadata.version('rig')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Robot metrology with a ball link and two digital probes: record, analyse, compare."""


from analysis.cli import (  # noqa: E402 - each adds its commands
    analyse,  # noqa: F401
    automatic,  # noqa: F401
    calibrate,  # noqa: F401
    check,  # noqa: F401
    compare,  # noqa: F401
    correct,  # noqa: F401
    diagnose,  # noqa: F401
    doctor,  # noqa: F401
    emulate,  # noqa: F401
    example,  # noqa: F401
    export,  # noqa: F401
    import_,  # noqa: F401
    interfaces,  # noqa: F401
    live,  # noqa: F401
    logs,  # noqa: F401
    paper,  # noqa: F401
    plan,  # noqa: F401
    record,  # noqa: F401
    relabel,  # noqa: F401
    replay,  # noqa: F401
    runs,  # noqa: F401
    simulate,  # noqa: F401
)
