"""The outcome of an item: a value or an error, never an exception, because a bad run must not end the others."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from rigs.errors import CellError, FileError, RigError

Item = TypeVar("Item")
Value = TypeVar("Value")
_REMEDY = "check those in the rig file and in the readings"


@dataclass(frozen=True)
class CompletedItem(Generic[Item, Value]):
    """An item with a value. deaths: number of processes killed before while working on it."""

    item: Item
    value: Value
    deaths: int = 0


@dataclass(frozen=True)
class FailedItem(Generic[Item]):
    """An item with an error. deaths: number of processes killed while working on it."""

    item: Item
    error: RigError
    deaths: int = 0


Outcome = CompletedItem[Item, Value] | FailedItem[Item]


def attempt(work: Callable[[Item], Value], item: Item) -> Outcome[Item, Value]:
    """Do the work for an item. Exceptions that no run causes are bugs and are raised.

    A RuntimeWarning is an error here in every process: numpy warns only if a figure becomes NaN.
    """
    failure: RigError
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            return CompletedItem(item, work(item))
    except RigError as error:
        failure = error
    except MemoryError:
        remedy = "close other programs, or give fewer --jobs"
        failure = CellError(str(item), "not enough memory for this run", remedy, code="computer.memory")
    except (ArithmeticError, ValueError, RuntimeWarning) as error:
        if not is_numerical(error):
            raise
        failure = FileError(str(item), f"the computation failed: {error}", _REMEDY, code="run.numerical")
    return FailedItem(item, failure)


def is_numerical(error: BaseException) -> bool:
    """True if a computation failed numerically: overflow, NaN, or an error of a solver in numpy or scipy."""
    if isinstance(error, ArithmeticError | RuntimeWarning) or type(error).__name__ == "LinAlgError":
        return True
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return trace is not None and str(trace.tb_frame.f_globals.get("__name__")).startswith("scipy.")
