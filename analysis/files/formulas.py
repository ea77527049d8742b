"""Text in a CSV file that a spreadsheet would compute: a table from elsewhere may hold `=cmd|…` in a note.

Such a cell gets an apostrophe as its first character, by which a spreadsheet knows text; what is read from a CSV file
loses it again, so that a table that goes out and comes back is the same. Numbers are no text, and stay as they are.
"""

from __future__ import annotations

import re

_FORMULA = re.compile(r"'*[=+\-@\t\r]")
_WRITTEN = re.compile(r"'+[=+\-@\t\r]")
_NUMBER = re.compile(r"-?[0-9]+(\.[0-9]+)?([eE][+-]?[0-9]+)?")


def no_formula(text: str) -> str:
    """Text as no program computes it."""
    return f"'{text}" if _FORMULA.match(text) and not _NUMBER.fullmatch(text) else text


def as_it_was(text: str) -> str:
    """Text that `no_formula` wrote, as it was before."""
    return text[1:] if _WRITTEN.match(text) else text
