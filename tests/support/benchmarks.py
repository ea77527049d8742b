"""Benchmarks: CPU time of rig and of an alternative program, measured alternately.

Both are timed in the same process in alternating turns, and the fastest turn counts. Other load on the computer
therefore affects both equally.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

BEGIN, END = "<!-- measured: scripts/bench writes from here … -->", "<!-- … to here -->"
TURNS = 5
_LEAST_S = 0.02
"""Minimum CPU time of a turn. The process clock of some machines has a resolution of 4 ms."""
_PATIENCE_S = 20.0
"""CPU time after which no further turn starts."""


@dataclass(frozen=True)
class Peer:
    """The alternative program: name and callable. `missing` is the reason if there is no callable."""

    name: str
    call: Callable[[], object] | None = None
    missing: str = ""


@dataclass(frozen=True)
class Line:
    """A benchmark result with the upper limit (`goal`) and the result of the alternative, nan if there is none."""

    row: str
    what: str
    unit: str
    goal: float
    figure: float
    peer: str = "-"
    peer_figure: float = math.nan

    @property
    def reached(self) -> bool:
        """True if the result is within the limit."""
        return self.figure <= self.goal

    def cells(self) -> tuple[str, ...]:
        """Text of the table cells: row, quantity, unit, limit, result, alternative, its result, ratio and verdict."""
        return (
            self.row,
            self.what,
            self.unit,
            f"{self.goal:.3g}",
            f"{self.figure:.3g}",
            self.peer,
            *(
                "-" if math.isnan(value) else f"{value:.3g}"
                for value in (self.peer_figure, self.figure / self.peer_figure)
            ),
            "reached" if self.reached else "missed",
        )


HEAD = ("row", "case", "unit", "goal", "rig", "reference", "figure", "ratio", "outcome")


def table(lines: list[Line]) -> str:
    """Format results as a Markdown table."""
    rows = [HEAD, ("---",) * len(HEAD), *(line.cells() for line in lines)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in rows)


def page_with(page: str, measured: str) -> str:
    """Page with the text between its markers replaced by the results. Raises ValueError if there are no
    markers.
    """
    before, mark, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not mark or not end:
        raise ValueError(f"the page has no marks {BEGIN!r} and {END!r}")
    return f"{before}{BEGIN}\n\n{measured}\n\n{END}{after}"


def beside(ours: Callable[[], object], peer: Peer, count: int, turns: int = TURNS) -> tuple[float, float]:
    """CPU time in microseconds per item of rig and of the alternative, each the best of alternating turns.

    count: number of items processed by one call of either program. The time of a missing alternative is nan.
    """
    calls = [call for call in (ours, peer.call) if call is not None]
    for call in calls:
        call()  # compiled, imported, in the cache
    best, begin = [math.inf] * len(calls), time.process_time()
    for _ in range(turns):
        best = [min(known, _turn(call)) for known, call in zip(best, calls, strict=True)]
        if time.process_time() - begin > _PATIENCE_S:
            break
    return 1e6 * best[0] / count, 1e6 * best[1] / count if len(best) > 1 else math.nan


def _turn(call: Callable[[], object]) -> float:
    """CPU time in seconds of one call, averaged over as many calls as the clock resolution requires."""
    calls, begin = 0, time.process_time()
    while (spent := time.process_time() - begin) < _LEAST_S:
        call()
        calls += 1
    return spent / calls
