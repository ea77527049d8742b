"""Numbers as devices print them, and possible angles; anything else gives None and never an exception."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable

_NUMBER = re.compile(r"[+-]?(\d{1,18}(\.\d{0,18})?|\.\d{1,18})([eE][+-]?\d{1,2})?", re.ASCII)
_MAX_DEG = 1e6
"""No axis turns further from its zero."""
_LARGEST_BESIDE = 1e9
"""No speed in percent, no mass, no temperature and no program's number is larger."""


def number(text: str) -> float | None:
    """Return a decimal number, None for anything else (nan, inf, hexadecimals, underscores, a hundred digits)."""
    return float(text) if _NUMBER.fullmatch(text) else None


def are_angles(values_deg: Iterable[float]) -> bool:
    """Return whether all values are finite and possible for an axis."""
    return all(abs(value) < _MAX_DEG for value in values_deg)


def plausible(value: float) -> float:
    """Return what a robot shows beside its joints; nan for what no speed, mass, temperature or program can be."""
    return value if abs(value) <= _LARGEST_BESIDE else math.nan
