"""What a benchmark measures and how: CPU time of rig and of what a user would take instead, in turns.

Both are timed within one run of one process, in alternating turns of which the best counts: what else the machine does
then slows down both.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

BEGIN, END = "<!-- measured: scripts/bench writes from here … -->", "<!-- … to here -->"
TURNS = 5
_LEAST_S = 0.02
"""CPU of a turn, at least: the clock of a process has steps of up to 4 ms on some machines."""
_PATIENCE_S = 20.0
"""CPU after which no further turn begins."""


@dataclass(frozen=True)
class Peer:
    """What a user would take instead: its name and the call; `missing` says why there is no call."""

    name: str
    call: Callable[[], object] | None = None
    missing: str = ""


@dataclass(frozen=True)
class Line:
    """One figure beside its goal, the most that it may be, and beside the peer's, nan without one."""

    row: str
    what: str
    unit: str
    goal: float
    figure: float
    peer: str = "-"
    peer_figure: float = math.nan

    @property
    def reached(self) -> bool:
        """Whether the figure is within the goal."""
        return self.figure <= self.goal

    def cells(self) -> tuple[str, ...]:
        """Row, what, unit, goal, figure, peer, the peer's figure, rig/peer and the outcome, as text."""
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
    """A Markdown table of lines."""
    rows = [HEAD, ("---",) * len(HEAD), *(line.cells() for line in lines)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in rows)


def page_with(page: str, measured: str) -> str:
    """The page with what was measured between its marks. Raises ValueError for a page without them."""
    before, mark, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not mark or not end:
        raise ValueError(f"the page has no marks {BEGIN!r} and {END!r}")
    return f"{before}{BEGIN}\n\n{measured}\n\n{END}{after}"


def beside(ours: Callable[[], object], peer: Peer, count: int, turns: int = TURNS) -> tuple[float, float]:
    """CPU microseconds an item of ours and of the peer, best of alternating turns; the peer's is nan where missing.

    count: items of a call, of either.
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
    """CPU seconds of a call, over as many as the clock needs."""
    calls, begin = 0, time.process_time()
    while (spent := time.process_time() - begin) < _LEAST_S:
        call()
        calls += 1
    return spent / calls
