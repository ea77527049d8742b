r"""Sanitising of text from devices, files, names and peers for terminals, logs and pictures.

Every output of the programs passes through here, because foreign text may contain escape sequences, forged lines,
reversed reading directions and lone surrogates: docs/decisions/0018-one-gate-for-text.md.
"""

from __future__ import annotations

import difflib
import math
import os
import re
import shlex
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any


def escape_text(text: str) -> str:
    """Text in a single line with unprintable characters escaped."""
    if text.isprintable():
        return text
    return "".join(char if char.isprintable() else repr(char)[1:-1] for char in text)


def counted(count: int, singular: str, plural: str = "") -> str:
    return f"{count} {singular if count == 1 else plural or singular + 's'}"


def as_argument(path: Path | str) -> str:
    return shlex.quote(str(path))


def forget_width_of_0() -> None:
    """Remove COLUMNS=0 from the environment, a width that would break every layout."""
    if os.environ.get("COLUMNS") == "0":
        del os.environ["COLUMNS"]


def escape_lines(text: str) -> str:
    return "\n".join(map(escape_text, text.split("\n")))


def escape_values(value: Any) -> Any:
    match value:
        case str():
            return escape_text(value)
        case dict():
            return {escape_text(key): escape_values(item) for key, item in value.items()}
        case list() | tuple():
            return [escape_values(item) for item in value]
    return value


def listed(numbers: list[int], most: int = 8) -> str:
    """Format numbers as `3, 7 and 9`, limited to the first ones."""
    return enumerated([str(number) for number in numbers]) if len(numbers) <= most else first_of(numbers, most)


def first_of(items: Sequence[object], most: int, separator: str = ", ") -> str:
    """Join the first items, and add the number of the others: `3, 7, 9 and 4 more`."""
    rest = f" and {len(items) - most} more" if len(items) > most else ""
    return separator.join(map(str, items[:most])) + rest


def enumerated(words: Sequence[str], last: str = "and") -> str:
    """Format words as `a, b and c`, with a different word before the last one if given; empty without words."""
    return f" {last} ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))


_NONZERO = re.compile(r"[+-]?[0.]*[1-9]")


def is_too_small(text: str) -> bool:
    """Whether a decimal number other than zero is read as zero.

    >>> is_too_small("1e-400"), is_too_small("0e-400")
    (True, False)
    """
    return _NONZERO.match(text) is not None and float(text) == 0


def numbers_in(text: str) -> tuple[float, ...]:
    """Parse finite numbers separated by commas; empty if the text contains anything else."""
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        return ()
    return numbers if all(map(math.isfinite, numbers)) else ()


_MOST_NEAR = 3


def the_same(name: str, names: Collection[str]) -> str | None:
    """Known name equal to `name`, ignoring case and punctuation if only one name matches; otherwise None."""
    if name in names:
        return name
    alike = [candidate for candidate in names if _letters(candidate) == _letters(name)]
    return alike[0] if len(alike) == 1 else None


def nearest(name: str, names: Collection[str]) -> list[str]:
    """Up to three names that contain the given name, or otherwise similar names."""
    written = _letters(name)
    within = [candidate for candidate in names if written and written in _letters(candidate)]
    return (within or difflib.get_close_matches(name.lower(), names, cutoff=0.5))[:_MOST_NEAR]


def _letters(name: str) -> str:
    return "".join(char for char in name.casefold() if char.isalnum())
