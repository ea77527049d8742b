"""Names as people write them: UR10E, ur-10e and Ur 10e are ur10e."""

from __future__ import annotations

import difflib
from collections.abc import Collection

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
