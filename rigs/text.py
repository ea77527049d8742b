"""The gate for text: what a device, a file, a name or a peer supplied, as a terminal, a log or a picture can bear it.

Foreign text may hold escape sequences that reprogram a terminal, line ends that forge a line of a log, marks that
reverse the reading direction, and lone surrogates that no encoder accepts. Each such character is shown as its escape
(`\\x1b`), so that nothing is hidden, and passing a text through twice changes nothing. Every output of the programs
goes through here at the place where it leaves them: docs/decisions/0018-one-gate-for-text.md.

Names are as people write them: UR10E, ur-10e and Ur 10e are ur10e.
"""

from __future__ import annotations

import difflib
import os
import shlex
from collections.abc import Collection
from pathlib import Path
from typing import Any


def plain(text: str) -> str:
    """Return text in one line, every unprintable character as its escape."""
    if text.isprintable():
        return text
    return "".join(char if char.isprintable() else repr(char)[1:-1] for char in text)


def counted(count: int, singular: str, plural: str = "") -> str:
    """Return `1 run`, `2 runs`."""
    return f"{count} {singular if count == 1 else plural or singular + 's'}"


def as_argument(path: Path | str) -> str:
    """Return a path as a shell takes it, for a command that a person may copy from a message."""
    return shlex.quote(str(path))


def forget_width_of_0() -> None:
    """Remove COLUMNS=0 from the environment: such a width is unknown, and everything would be laid out in no
    columns at all."""
    if os.environ.get("COLUMNS") == "0":
        del os.environ["COLUMNS"]


def plain_lines(text: str) -> str:
    """Return text of several lines, each of them plain; only the line feeds between them stay."""
    return "\n".join(map(plain, text.split("\n")))


def plain_values(value: Any) -> Any:
    """Return a value of JSON with every text in it plain, the keys of objects as well."""
    match value:
        case str():
            return plain(value)
        case dict():
            return {plain(key): plain_values(item) for key, item in value.items()}
        case list():
            return [plain_values(item) for item in value]
    return value


def listed(numbers: list[int]) -> str:
    """Return numbers as `3, 7 and 9`, no more than eight of them."""
    shown = [str(number) for number in numbers[:8]]
    if len(numbers) > 8:
        return ", ".join(shown) + f" and {len(numbers) - 8} more"
    return shown[0] if len(shown) == 1 else ", ".join(shown[:-1]) + f" and {shown[-1]}"


_MOST_NEAR = 3


def the_same(name: str, names: Collection[str]) -> str | None:
    """Return the one of some names that a person means: the name itself, or else the only one of its letters and
    digits, whatever their case; None where there is none."""
    if name in names:
        return name
    alike = [candidate for candidate in names if _letters(candidate) == _letters(name)]
    return alike[0] if len(alike) == 1 else None


def nearest(name: str, names: Collection[str]) -> list[str]:
    """Return the names that contain a name, as a person writes it, or else those that look like it; three at most."""
    written = _letters(name)
    within = [candidate for candidate in names if written and written in _letters(candidate)]
    return (within or difflib.get_close_matches(name.lower(), names, cutoff=0.5))[:_MOST_NEAR]


def _letters(name: str) -> str:
    return "".join(char for char in name.casefold() if char.isalnum())
