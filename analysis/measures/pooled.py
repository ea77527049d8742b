"""Several runs of one test as one figure: their mean, what differs between them, and acw against cw pair by pair.

u of one run says how well that run's figure is known; what differs from run to run is not in it and shows only where
runs are repeated. The mean of m runs then has Student's law with m - 1 degrees of freedom.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.kinematics.arm import Array
from analysis.kinematics.limits import wrapped
from analysis.measures.direction_pair import pair
from analysis.measures.link_angle import CircleResult
from analysis.measures.quantity import PLACE, Quantity, half_turns, is_around_circle, student_factor
from analysis.measures.radial import RadialResult
from analysis.measures.results import Result
from analysis.noise.cell import BALL_ELSEWHERE_MM, BALL_MM, JOINT_DEG, least_known
from analysis.traces.tables import PlaceTable
from rigs.errors import FileError

ONE_RUN = (
    "one run only: what differs between runs is not in u; expect the ball "
    f"{1e3 * BALL_MM.low:g} to {1e3 * BALL_MM.high:g} µm and each joint {JOINT_DEG.low:g} to {JOINT_DEG.high:g}° "
    "elsewhere in the next, and repeat it to see"
)
_SPREADS = 5.0
"""A ball further from the others' than `BALL_ELSEWHERE_MM`, and than so many times the usual distance of these
runs, which the scatter of joints makes too, was mounted again; …"""
_TWO_MM = 0.35
"""… of two runs, where nothing shows that scatter: 2 √2 times the table's largest at the end of an arm of a metre."""
_SAME_POSE_RAD = math.radians(1.0)
"""Joints nearer to one another are at the same pose of a table. Chosen: far above what joints differ by from run to
run, and far below the way between two poses."""
_ANYWHERE_DEG = 180.0 / math.sqrt(3)
"""Standard uncertainty of a place that may be anywhere around the circle."""


@dataclass(frozen=True)
class BetweenRuns:
    """A figure over runs: mean, its standard uncertainty, and the standard deviation between the runs."""

    mean: Quantity
    sd: float
    runs: int

    def __str__(self) -> str:
        return f"{self.mean}, sd {self.in_sd}"

    @property
    def in_sd(self) -> str:
        """The standard deviation between the runs, as people read it."""
        return self.mean.rounded_size(self.sd)


@dataclass(frozen=True)
class Pooled:
    """Runs of one test and direction that were taken together; left_out: the others, each with the reason."""

    title: str
    runs: tuple[Result, ...]
    left_out: tuple[tuple[Result, str], ...]
    figures: dict[str, BetweenRuns]


@dataclass(frozen=True)
class Pairs:
    """acw against cw: the runs that were paired, their figures with the lag of the gauges in ms, and why others were
    not."""

    runs: tuple[tuple[Result, Result], ...]
    figures: dict[str, Quantity | BetweenRuns]
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


def between(runs: Sequence[Mapping[str, Quantity]]) -> dict[str, BetweenRuns]:
    """Figures that all runs have, over the runs. The u of a mean is never below the least u of a run, part of which,
    the gauges' time and baseline, all runs share."""
    names = [name for name in runs[0] if all(name in run for run in runs)]
    return {name: _between(name, [run[name] for run in runs]) for name in names}


def _between(name: str, figures: Sequence[Quantity]) -> BetweenRuns:
    values = np.array([figure.value for figure in figures])
    if is_around_circle(name):
        values = values[0] + half_turns(values - values[0])
    count, sd = len(values), float(values.std(ddof=1))
    u = float(np.hypot(student_factor(count - 1) * sd / np.sqrt(count), min(figure.u for figure in figures)))
    middle = float(values.mean())
    if is_around_circle(name):
        u = min(u, _ANYWHERE_DEG)
        middle = middle % 360.0 if name.endswith(PLACE) else float(half_turns(np.array(middle)))
    source = least_known(figure.noise for figure in figures)
    samples = sum(figure.samples for figure in figures)
    return BetweenRuns(Quantity(middle, u, figures[0].unit, samples, source), sd, count)


def _of_one_setup(runs: list[Result]) -> tuple[list[Result], list[tuple[Result, str]]]:
    """The runs that belong together, and the others, each with the reason: readings given twice, other poses, and balls
    mounted again."""
    once: dict[str, Result] = {}
    copies: list[tuple[Result, str]] = []
    for run in runs:
        first = once.setdefault(run.measured.run.readings_sha256, run)
        if first is not run:
            copies.append((run, f"holds the same readings as {first.measured.path}: left out of the mean"))
    single = list(once.values())
    together = max(([run for run in single if _are_same_poses(one, run)] for one in single), key=len)
    why = f"its poses are not those of {together[0].measured.path}: left out of the mean"
    copies += [(run, why) for run in single if not any(run is one for one in together)]
    single = together
    balls = [ball for ball in map(_ball_mm, single) if ball is not None]
    if len(balls) < max(2, len(single)):
        return single, copies
    away = np.linalg.norm(np.array(balls) - np.median(balls, axis=0), axis=1)
    if len(single) == 2:
        if 2 * away.max() <= _TWO_MM:
            return single, copies
        why = f"the balls of the two runs lie {2 * away.max():.2f} mm apart: two set-ups have no common mean"
        return [], [*copies, *((run, why) for run in single)]
    limit = max(BALL_ELSEWHERE_MM, _SPREADS * float(np.median(away)))
    near = [run for run, far in zip(single, away, strict=True) if far <= limit]
    others = [
        (run, f"its ball lies {far:.2f} mm from that of the other runs: another set-up, left out of the mean")
        for run, far in zip(single, away, strict=True)
        if far > limit
    ]
    return near, [*copies, *others]


def _are_same_poses(first: Result, run: Result) -> bool:
    """Whether a pose run has the poses of another; of other tests the set-up decides."""
    one, other = first.measured.table, run.measured.table
    if not (isinstance(one, PlaceTable) and isinstance(other, PlaceTable)):
        return True
    return one.q.shape == other.q.shape and float(np.abs(wrapped(one.q - other.q)).max()) < _SAME_POSE_RAD


def _ball_mm(run: Result) -> Array | None:
    """Where a run has its ball, mm; None in tests that do not show it."""
    match run.found:
        case CircleResult():
            return run.found.distance.ball_mm
        case RadialResult():
            return run.found.free.centre
    return None


def pairs_of(group: Sequence[Result]) -> Pairs | None:
    """Every acw run with the cw run of the same place in the order given; None without both."""
    ways = {
        way: [one for one in group if isinstance(one.found, CircleResult) and one.found.laps.direction == way]
        for way in ("acw", "cw")
    }
    both, alone = _matched(ways["acw"], ways["cw"])
    if not both:
        return None
    runs, found = [], []
    refused = [f"{one.name}: there is no run of the other direction to pair it with" for one in alone]
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
    figures: dict[str, Quantity | BetweenRuns] = {
        **(between([one.figures for one in found]) if several else found[0].figures)
    }
    lag = between([{"lag_ms": one.lag} for one in found])["lag_ms"].mean if several else found[0].lag
    return Pairs(tuple(runs), figures, lag, tuple(refused))


def _matched(acw: list[Result], cw: list[Result]) -> tuple[list[tuple[Result, Result]], list[Result]]:
    """Each acw run with a cw run whose ball lies with its own, else in the order given; and the runs that are left."""
    left, both, alone = list(cw), [], []
    for one in acw:
        if not left:
            alone.append(one)
            continue
        nearest = min(left, key=lambda other: _apart_mm(one, other))
        left.remove(nearest)
        both.append((one, nearest))
    return both, [*alone, *left]


def _apart_mm(one: Result, other: Result) -> float:
    """How far the balls of two circles are apart by the angle, which plays move less than the distance; 0 within what a
    set-up does."""
    assert isinstance(one.found, CircleResult) and isinstance(other.found, CircleResult)  # noqa: S101 - circles alone
    sine, its, radius = one.found.sine, other.found.sine, one.found.laps.frame.radius
    apart = radius * float(np.hypot(sine.a - its.a, sine.b - its.b))
    return apart if apart > BALL_ELSEWHERE_MM else 0.0
