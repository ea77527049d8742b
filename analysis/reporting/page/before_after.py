"""The error of a robot before and after its correction, as measured on the robot itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Side:
    """An error of the path in µm with its standard uncertainty, the largest, and of how many runs."""

    um: float
    u_um: float
    largest_um: float
    runs: int


@dataclass(frozen=True)
class BeforeAfter:
    """What was corrected, and the error before and after on the same circle, and at a place that was not used; None
    where nothing was driven afterwards."""

    correction: str
    rows: tuple[tuple[Literal["same", "elsewhere"], Side, Side | None], ...]
