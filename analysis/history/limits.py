"""Where a series stands against the limits of the rig file, and since when.

Each run is judged by the rule of the report (ISO 14253-1, `rigs.schema.limits`) with its own uncertainty. A series
stands where its newest run stands. It crossed a bound at the first run proven beyond it after the last one proven
within, and came back the other way round: a run whose uncertainty reaches over the bound moves no date. Wild runs
before others are left out, as they are from the search for changes. The newest ones count: a damage that came suddenly
is wild until it has lasted for some runs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.history.history import Series
from analysis.history.records import Record
from rigs.schema.limits import Limit, Standing

_CROSSED: dict[Standing, tuple[tuple[Standing, ...], Standing]] = {
    "pass": (("pass",), "fail"),
    "watch": (("watch", "fail"), "pass"),
    "fail": (("fail",), "pass"),
}
"""How the first run since the crossing stands against the bound that decides, and how the last one before it, for each
standing of a series."""


@dataclass(frozen=True)
class Judged:
    """A series against its limit. standing: of the newest run; bound: that decided it; since: the first run after the
    crossing; beyond: every run that fails, in order of time; count: how many runs were judged."""

    limit: Limit
    standing: Standing
    bound: float
    since: Record
    newest: Record
    beyond: tuple[Record, ...]
    count: int


def judge(series: Series) -> Judged | None:
    """Return where a series stands, None where it has no limit."""
    if series.limit is None:
        return None
    last = max(np.flatnonzero(~series.trend.wild), default=-1)
    kept = enumerate(zip(series.runs, series.quantities, series.trend.wild, strict=True))
    runs = [(run, quantity) for k, (run, quantity, is_wild) in kept if not is_wild or k > last]
    standings = [series.limit.standing(quantity.value, quantity.u) for _, quantity in runs]
    bound = _deciding(series.limit, standings[-1])
    against = [Limit(fail=bound).standing(quantity.value, quantity.u) for _, quantity in runs]
    after, before = _CROSSED[standings[-1]]
    crossed = max((k for k, standing in enumerate(against) if standing == before), default=-1) + 1
    since = next(k for k in range(crossed, len(runs)) if against[k] in after)
    beyond = tuple(run for (run, _), standing in zip(runs, standings, strict=True) if standing == "fail")
    return Judged(series.limit, standings[-1], bound, runs[since][0], runs[-1][0], beyond, len(runs))


def _deciding(limit: Limit, standing: Standing) -> float:
    """The bound that decided: `fail` where a figure is beyond it, else the lower one, in the figure's unit."""
    bounds = [size for size in (limit.watch, limit.fail) if size is not None]
    return bounds[-1] if standing == "fail" else bounds[0]
