"""The command `rig`: its entry point, and how it ends. `commands` lists each command and imports its file."""

from __future__ import annotations

import errno
import gc
import io
import os
import sys
import warnings
from typing import NoReturn

import typer
from typer.exceptions import TyperException

from analysis.cli.commands import app
from analysis.cli.console import say_error
from analysis.runs.batch.outcomes import is_numerical
from rigs.errors import CellError, FileError, RigError, wrong_use
from rigs.signals import ignore_interrupts
from rigs.text import forget_width_of_0

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
_OF_A_CELL = ("fcntl", "grp", "resource", "termios", "tty")
"""Modules that Windows lacks: serial lines, and the socket of a running daemon."""

_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
"""What the libraries beneath numpy and scipy read as they load. Their threads cost a diagnosis more than they give: its
matrices are small, so two threads took 27.5 s of processor time where one takes 9.8 s (two cores, measured)."""

_NO_PLUGINS = "PYDANTIC_DISABLE_PLUGINS"
"""Without it pydantic reads what every installed package declares, for plugins: a twentieth of a small run."""

_GARBAGE = 100_000
"""Objects after which Python looks for garbage. Imports make tens of thousands that stay: looked through at every 700,
as Python has it, they cost a tenth of the time that a small run takes (0.80 of 0.89 s of CPU, measured)."""

_INTERRUPTED = 130
"""What a shell expects of a program that Ctrl-C ended."""


def main() -> None:
    """Entry point: every expected failure is one line and an exit code."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # a terminal that knows no φ is no reason to say nothing
    os.environ.update({name: os.environ.get(name, "1") for name in (*_THREADS, _NO_PLUGINS)})
    forget_width_of_0()
    gc.set_threshold(_GARBAGE)
    # numpy only warns where a figure becomes nan; such a figure is no result.
    warnings.simplefilter("error", RuntimeWarning)
    try:
        sys.exit(app(standalone_mode=False))
    except TyperException as error:
        _wrong_use(error)
    except typer.Abort:
        sys.exit(1)
    except KeyboardInterrupt:  # between the command and here
        sys.exit(_INTERRUPTED)
    except RigError as error:
        _fail(error)
    except ModuleNotFoundError as error:
        if error.name not in _OF_A_CELL:
            raise
        command = " ".join(["rig", *sys.argv[1:2]])
        remedy = "run the command on the computer of the cell; this computer analyses saved runs"
        _fail(CellError(command, f"needs Linux: this system lacks {error.name}", remedy))
    except BrokenPipeError:
        sys.exit(0)
    except (ArithmeticError, ValueError, RuntimeWarning) as error:
        if not is_numerical(error):
            raise
        problem = f"the computation failed: {error}"
        _fail(FileError("numbers", problem, "check the values in the rig file and in the runs"))
    except (MemoryError, OSError) as error:
        _out_of_room(error)
    finally:
        ignore_interrupts()


def _out_of_room(error: MemoryError | OSError) -> NoReturn:
    """Report memory or a disk that is full in one line; any other error of the system is raised again."""
    if isinstance(error, MemoryError) or error.errno == errno.ENOMEM:
        _fail(
            CellError(
                "memory", "the memory or disk is too small", "close other programs, or give fewer or shorter runs"
            )
        )
    if error.errno not in _NO_ROOM or error.filename is not None:
        raise error
    # What is left in the buffer would fail once more at the end.
    full = CellError("output", error.strerror or str(error), "free some space, or choose a different --output")
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    _fail(full)


def _fail(error: RigError) -> NoReturn:
    say_error(error)
    sys.exit(error.exit_code)


def _wrong_use(error: TyperException) -> NoReturn:
    use_error = wrong_use(error, "rig")
    if use_error is None:  # its help is printed; for `rig` alone that is what was asked for
        sys.exit(2 if sys.argv[1:] else 0)
    _fail(use_error)
