"""Entry point and exit codes of the command `rig`, whose commands are listed in the module `commands`."""

from __future__ import annotations

import atexit
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
from analysis.cli.console import INTERRUPTED, say_error, say_interrupted
from rigs.errors import CellError, FileError, RigError, wrong_use
from rigs.signals import COMPLETED, REPLACED, ignore_interrupts
from rigs.text import forget_width_of_0

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
_OF_A_CELL = ("fcntl", "grp", "os", "resource", "termios", "tty")
"""Modules missing on Windows, or without their POSIX functions, used for serial lines and the socket of a daemon."""

_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
"""Variables that numpy and scipy read on import. The matrices are small: two threads took 27.5 s of processor time, one
9.8 s."""

_NO_PLUGINS = "PYDANTIC_DISABLE_PLUGINS"
"""Setting that stops pydantic from scanning all installed packages for plugins: a twentieth of a small run."""

_GARBAGE = 200_000
"""Number of new objects that triggers garbage collection: the imports of a command create more than 100 000. With
Python's default of 700, collections took a tenth of a small run (measured)."""


def main() -> None:
    """Entry point: report every expected failure in a line and set the exit code."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # a terminal that cannot show φ shows ? instead
    os.environ.update({name: os.environ.get(name, "1") for name in (*_THREADS, _NO_PLUGINS)})
    forget_width_of_0()
    COMPLETED.clear()
    REPLACED.clear()
    gc.set_threshold(_GARBAGE)
    atexit.register(gc.freeze)  # collections at exit take a seventh of a small run, and the memory is returned anyway
    # numpy only warns when a figure becomes nan; such a figure is not a result.
    warnings.simplefilter("error", RuntimeWarning)
    try:
        sys.exit(app(standalone_mode=False))
    except TyperException as error:
        _wrong_use(error)
    except typer.Abort:
        sys.exit(1)
    except KeyboardInterrupt:  # between the command and this point
        say_interrupted()
        sys.exit(INTERRUPTED)
    except RigError as error:
        _fail(error)
    except ImportError as error:
        if error.name not in _OF_A_CELL:
            raise
        command = " ".join(["rig", *sys.argv[1:2]])
        remedy = "run the command on the computer of the cell; this computer analyses saved runs"
        _fail(CellError(command, f"needs Linux: {error.msg}", remedy, code="computer.unsuitable"))
    except BrokenPipeError:
        sys.exit(0)
    except (ArithmeticError, ValueError, RuntimeWarning) as error:
        from analysis.runs.batch import is_numerical

        if not is_numerical(error):
            raise
        problem, remedy = f"the computation failed: {error}", "check the values in the rig file and in the runs"
        _fail(FileError("numbers", problem, remedy, code="readings.unsuitable"))
    except (MemoryError, OSError) as error:
        _out_of_room(error)
    finally:
        ignore_interrupts()


def _out_of_room(error: MemoryError | OSError) -> NoReturn:
    if isinstance(error, MemoryError) or error.errno == errno.ENOMEM:
        remedy = "close other programs, or give fewer or shorter runs"
        _fail(CellError("memory", "the memory or disk is too small", remedy, code="computer.unsuitable"))
    if error.errno not in _NO_ROOM or error.filename is not None:
        raise error
    problem, remedy = error.strerror or str(error), "free some space, or choose a different --output"
    full = CellError("output", problem, remedy, code="disk.full")
    # The remaining buffer would cause a second failure at exit.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    _fail(full)


def _fail(error: RigError) -> NoReturn:
    say_error(error)
    sys.exit(error.exit_code)


def _wrong_use(error: TyperException) -> NoReturn:
    use_error = wrong_use(error, "rig")
    if use_error is None:  # the help is printed; plain `rig` requests it
        sys.exit(2 if sys.argv[1:] else 0)
    _fail(use_error)
