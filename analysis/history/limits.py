"""Where a series stands against the limits of the rig file, and since when.

Each run is judged by the rule of the report (ISO 14253-1, `rigs.schema.limits`) with its own uncertainty. A series
stands where its newest run stands, and has stood there since the first run of the unbroken row that ends with it. Wild
runs are left out, as they are from the search for changes.
"""

from __future__ import annotations

from dataclasses import dataclass

from analysis.history.history import Series
from analysis.history.records import Record
from rigs.schema.limits import Limit, Standing

_ROWS: dict[Standing, tuple[Standing, ...]] = {"pass": ("pass",), "watch": ("watch", "fail"), "fail": ("fail",)}
"""What the runs of an unbroken row may be, by the standing of the newest: a run that fails is one to watch, too."""


@dataclass(frozen=True)
class Judged:
    """A series against its limit. standing: of the newest run; since: the first run of the unbroken row that
    ends with it; beyond: every run that fails, in order of time; count: how many runs were judged."""

    limit: Limit
    standing: Standing
    since: Record
    newest: Record
    beyond: tuple[Record, ...]
    count: int

    @property
    def bound(self) -> float:
        """The bound that decided: `fail` where the figure is beyond it, else the lower one, in the figure's unit."""
        bounds = [one for one in (self.limit.watch, self.limit.fail) if one is not None]
        return bounds[-1] if self.standing == "fail" else bounds[0]


def judge(series: Series) -> Judged | None:
    """Return where a series stands, None where it has no limit."""
    if series.limit is None:
        return None
    kept = zip(series.runs, series.quantities, series.trend.wild, strict=True)
    judged = [(run, series.limit.standing(one.value, one.u)) for run, one, is_wild in kept if not is_wild]
    newest, standing = judged[-1]
    outside = [k for k, (_, one) in enumerate(judged) if one not in _ROWS[standing]]
    since = judged[outside[-1] + 1 if outside else 0][0]
    beyond = tuple(run for run, one in judged if one == "fail")
    return Judged(series.limit, standing, since, newest, beyond, len(judged))
