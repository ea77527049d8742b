"""Several runs of one test as one figure: their mean, what differs between them, and acw against cw pair by pair.

u of one run says how well that run's figure is known; what differs from run to run is not in it and shows only where
runs are repeated. The mean of m runs then has Student's law with m - 1 degrees of freedom.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.noise.cell import BALL_MM, JOINT_DEG
from analysis.reporting.quantity import Quantity
from analysis.reporting.results import Result
from analysis.tests.circle import CircleResult
from analysis.tests.pair import pair
from rigs.errors import FileError

ONE_RUN = (
    "one run only: what differs between runs is not in u; expect the ball "
    f"{1e3 * BALL_MM.low:g} to {1e3 * BALL_MM.high:g} µm and each joint {JOINT_DEG.low:g} to {JOINT_DEG.high:g}° "
    "elsewhere in the next, and repeat it to see"
)
_STUDENT = (6.985, 2.266, 1.653, 1.434, 1.324, 1.259, 1.215, 1.184, 1.160)
"""Half of what reaches 95.45 % of Student's law to either side, for 1, 2, … degrees of freedom; below, by 1 +
1.25/ν."""
_ELSEWHERE_MM = 0.06
"""A ball so far from the others' was mounted anew: three times what clamping and temperature do in a cell."""


@dataclass(frozen=True)
class Between:
    """A figure over runs: mean, its standard uncertainty, and the standard deviation between the runs."""

    mean: Quantity
    sd: float
    runs: int

    def __str__(self) -> str:
        return f"{self.mean}, sd {self.in_sd}"

    @property
    def in_sd(self) -> str:
        """The standard deviation between the runs, as people read it."""
        return self.mean.rounded(self.sd)


@dataclass(frozen=True)
class Pooled:
    """Runs of one test and direction that were taken together; left_out: the others, each with the reason."""

    title: str
    runs: tuple[Result, ...]
    left_out: tuple[tuple[Result, str], ...]
    figures: dict[str, Between]


@dataclass(frozen=True)
class Pairs:
    """acw against cw: the runs that were paired, their figures with the lag of the gauges in ms, and why others were
    not."""

    runs: tuple[tuple[Result, Result], ...]
    figures: dict[str, Quantity | Between]
    lag: Quantity | None
    refused: tuple[str, ...]


def pooled(group: Sequence[Result]) -> list[Pooled]:
    """Runs of one test, direction by direction; where a direction has a single run there is nothing to pool."""
    found = []
    for title in dict.fromkeys(result.title for result in group):
        runs, others = _of_one_setup([result for result in group if result.title == title])
        if len(runs) > 1:
            found.append(Pooled(title, tuple(runs), tuple(others), between([run.figures for run in runs])))
        elif others:
            found.append(Pooled(title, tuple(runs), tuple(others), {}))
    return found


def between(runs: Sequence[Mapping[str, Quantity]]) -> dict[str, Between]:
    """Figures that all runs have, over the runs. The u of a mean is never below the least u of a run, part of which,
    the gauges' time and baseline, all runs share."""
    names = [name for name in runs[0] if all(name in run for run in runs)]
    return {name: _between(name, [run[name] for run in runs]) for name in names}


def _between(name: str, figures: Sequence[Quantity]) -> Between:
    values = np.array([figure.value for figure in figures])
    if name.endswith(("_at_deg", "shift_deg")):
        values = values[0] + (values - values[0] + 180.0) % 360.0 - 180.0
    count, sd = len(values), float(values.std(ddof=1))
    freedom = count - 1
    factor = _STUDENT[freedom - 1] if freedom <= len(_STUDENT) else 1 + 1.25 / freedom
    u = max(factor * sd / np.sqrt(count), min(figure.u for figure in figures))
    first = figures[0]
    middle = float(values.mean())
    if name.endswith("_at_deg"):
        middle %= 360.0
    mean = Quantity(middle, float(u), first.unit, sum(figure.samples for figure in figures), first.noise)
    return Between(mean, sd, count)


def _of_one_setup(runs: list[Result]) -> tuple[list[Result], list[tuple[Result, str]]]:
    """The runs whose balls lie together, and the others, each with the reason."""
    balls = [run.found.distance.ball_mm for run in runs if isinstance(run.found, CircleResult)]
    if len(balls) < 2:
        return runs, []
    middle = np.median(balls, axis=0)
    away = np.linalg.norm(np.array(balls) - middle, axis=1)
    if len(runs) == 2 and away.max() > _ELSEWHERE_MM / 2:
        apart = 2 * float(away.max())
        return [], [
            (run, f"the balls of the two runs lie {apart:.2f} mm apart: no mean of two set-ups") for run in runs
        ]
    near = [run for run, far in zip(runs, away, strict=True) if far <= _ELSEWHERE_MM]
    others = [
        (run, f"its ball lies {far:.2f} mm from that of the other runs: another set-up, left out of the mean")
        for run, far in zip(runs, away, strict=True)
        if far > _ELSEWHERE_MM
    ]
    return near, others


def pairs_of(group: Sequence[Result]) -> Pairs | None:
    """Every acw run with the cw run of the same place in the order given; None without both."""
    by_way: dict[str, list[Result]] = {"acw": [], "cw": []}
    for result in group:
        if isinstance(result.found, CircleResult):
            by_way[result.found.laps.direction].append(result)
    both = list(zip(by_way["acw"], by_way["cw"], strict=False))
    if not both:
        return None
    runs, found, refused = [], [], []
    for acw, cw in both:
        assert isinstance(acw.found, CircleResult) and isinstance(cw.found, CircleResult)  # noqa: S101 - as chosen above
        try:
            found.append(pair(acw.found, cw.found, f"{acw.name} and {cw.name}"))
            runs.append((acw, cw))
        except FileError as error:
            refused += error.lines()
    if not found:
        return Pairs((), {}, None, tuple(refused))
    several = len(found) > 1
    figures: dict[str, Quantity | Between] = {
        **(between([one.figures for one in found]) if several else found[0].figures)
    }
    lag = between([{"lag_ms": one.lag} for one in found])["lag_ms"].mean if several else found[0].lag
    return Pairs(tuple(runs), figures, lag, tuple(refused))
