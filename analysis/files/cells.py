"""One cell of a table: its value, or why it has none.

Python's own float() takes `1_000`, `nan` and digits of any script; a table of measurements does not.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence

import numpy as np

from analysis.files.table_problems import quoted
from analysis.kinematics.arm import Array
from analysis.traces.table_layout import COUNTS, SOCKET, WORDS
from analysis.traces.table_rules import LARGEST
from rigs.schema.vocabulary import direction_of

_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
_COUNT = re.compile(r"\+?[0-9]{1,9}(\.0*)?")
_OF_NUMBERS = re.compile(r"[0-9+\-.eE \t,]*")
"""Where a text has no other characters, float() and `value` agree on whether it is a number."""
Value = float | int | str
MOST_LETTERS = 40


def value(column: str, text: str) -> Value:
    """The value of a cell of a known column. Raises ValueError with the reason in words."""
    text = text.strip(" \t")
    if not text:
        raise ValueError("has no value; fill it in or remove the row")
    if column == SOCKET:
        return _label(text)
    if column in WORDS:
        return _word(text, WORDS[column])
    return _count(text) if column in COUNTS else _number(text)


def numbers(texts: Sequence[str]) -> Array | None:
    """The values (n,) of cells of a column of numbers; None where `value` has to look at them one by one."""
    if not _OF_NUMBERS.fullmatch(",".join(texts)):
        return None
    try:
        found = np.fromiter(map(float, texts), dtype=float, count=len(texts))
    except ValueError:
        return None
    return found if np.abs(found).max(initial=0.0) <= LARGEST else None


def _number(text: str) -> float:
    if not _NUMBER.fullmatch(text):
        raise ValueError(f"{quoted(text)} is {_what_it_is(text)}")
    number = float(text)
    if abs(number) > LARGEST:
        raise ValueError(f"{quoted(text)} is too large for a measured value; check the unit")
    return number


def _what_it_is(text: str) -> str:
    if re.fullmatch(r"[+-]?(nan|inf|infinity)(\(.*\))?", text, re.IGNORECASE):
        return "not a finite number"
    if re.fullmatch(r"[+-]?[0-9]+,[0-9]+", text):
        return f"written with a decimal comma; write {text.replace(',', '.')}"
    return "not a number"


def _count(text: str) -> int:
    if not _COUNT.fullmatch(text) or float(text) < 1:
        raise ValueError(f"{quoted(text)} is not a positive integer: 1, 2, 3, …")
    return int(float(text))


def _label(text: str) -> str:
    if len(text) > MOST_LETTERS or not text.isprintable():
        raise ValueError(f"{quoted(text)} is no name of a socket: at most {MOST_LETTERS} letters, digits and signs")
    return text


def _word(text: str, known: tuple[str, ...]) -> str:
    if text in known:
        return text
    lower = text.lower()
    direction = direction_of(lower)
    near = [direction] if direction in known else difflib.get_close_matches(lower, known, n=1)
    hint = f"; did you mean {near[0]}?" if near else ""
    raise ValueError(f"{quoted(text)} is not {', '.join(known[:-1])} or {known[-1]}{hint}")
