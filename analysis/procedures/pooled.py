"""Combine runs of one test: means, spread between runs, pairs of acw and cw, and columns of figures for displays and
limits.

u of one run excludes the spread between runs, which only repeated runs show. The mean of m runs follows Student's
distribution with m - 1 degrees of freedom.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from analysis.procedures.circle import CircleResult
from analysis.procedures.direction_pair import pair
from analysis.procedures.radial import RadialResult
from analysis.procedures.results import Result
from analysis.procedures.shared.quantity import PLACE, Quantity, half_turns, is_around_circle, student_factor
from analysis.robot.kinematics.joint_limits import wrapped
from analysis.runs.noise.cell_noise import BALL_ELSEWHERE_MM, BALL_MM, JOINT_DEG, least_known
from analysis.runs.tables import PlaceTable
from rigs.errors import FileError

ONE_RUN = (
    "single run: u does not include the scatter between runs (typically "
    f"{1e3 * BALL_MM.low:g} to {1e3 * BALL_MM.high:g} µm for the ball and {JOINT_DEG.low:g} to {JOINT_DEG.high:g}° for "
    "each joint); repeat the run"
)
_SPREADS = 5.0
"""Multiple of the usual distance between the balls of runs, above which a ball counts as remounted.

The usual distance includes the scatter of the joints. The distance must also exceed `BALL_ELSEWHERE_MM`.
"""
_TWO_MM = 0.35
"""Limit in mm used for two runs, which give no information about the scatter: 2 √2 times the largest scatter of the
table, at the end of an arm of one metre.
"""
_SAME_POSE_RAD = math.radians(1.0)
"""Joint difference below which poses of a table are equal. Chosen: far above the differences between runs, and far
below those between poses."""
_ANYWHERE_DEG = 180.0 / math.sqrt(3)
"""Standard uncertainty of a position anywhere around the circle."""


@dataclass(frozen=True)
class BetweenRuns:
    """A figure over several runs: mean, standard uncertainty, and standard deviation between the runs."""

    mean: Quantity
    sd: float
    runs: int

    def __str__(self) -> str:
        return f"{self.mean}, sd {self.in_sd}"

    @property
    def in_sd(self) -> str:
        return self.mean.rounded_size(self.sd)


@dataclass(frozen=True)
class Pooled:
    """Combined runs of one test and direction; runs left out, with the reason."""

    title: str
    runs: tuple[Result, ...]
    left_out: tuple[tuple[Result, str], ...]
    figures: dict[str, BetweenRuns]


@dataclass(frozen=True)
class Pairs:
    """Pairs of acw and cw runs with their figures, the lag of the gauges in ms, and the reasons for unpaired runs."""

    runs: tuple[tuple[Result, Result], ...]
    figures: dict[str, Quantity | BetweenRuns]
    lag: Quantity | None
    refused: tuple[str, ...]


def pooled(group: Sequence[Result]) -> list[Pooled]:
    means = []
    for title in dict.fromkeys(result.title for result in group):
        repeats = [result for result in group if result.title == title]
        if len(repeats) == 1:
            continue
        runs, left_out = _of_one_setup(repeats)
        if len(runs) > 1:
            means.append(
                Pooled(title, tuple(runs), tuple(left_out), figures_between_runs([run.figures for run in runs]))
            )
        elif left_out:
            means.append(Pooled(title, tuple(runs), tuple(left_out), {}))
    return means


def figures_between_runs(runs: Sequence[Mapping[str, Quantity]]) -> dict[str, BetweenRuns]:
    """Figures common to all runs, combined.

    The u of a mean is at least the smallest u of a run, a part of which (time and baseline of the gauges) is common to
    all.
    """
    over_runs = {}
    for name in (name for name in runs[0] if all(name in run for run in runs)):
        figures = [run[name] for run in runs]
        values = np.array([figure.value for figure in figures])
        if is_around_circle(name):
            values = values[0] + half_turns(values - values[0])
        count, sd, middle = len(values), float(values.std(ddof=1)), float(values.mean())
        u = float(np.hypot(student_factor(count - 1) * sd / np.sqrt(count), min(figure.u for figure in figures)))
        if is_around_circle(name):
            u = min(u, _ANYWHERE_DEG)
            middle = middle % 360.0 if name.endswith(PLACE) else float(half_turns(np.array(middle)))
        source = least_known(figure.noise for figure in figures)
        samples = sum(figure.samples for figure in figures)
        over_runs[name] = BetweenRuns(Quantity(middle, u, figures[0].unit, samples, source), sd, count)
    return over_runs


def _of_one_setup(runs: list[Result]) -> tuple[list[Result], list[tuple[Result, str]]]:
    """Runs that belong together, and the others with the reason: repeated readings, other poses, a remounted ball."""
    by_digest: dict[str, Result] = {}
    copies: list[tuple[Result, str]] = []
    for run in runs:
        first = by_digest.setdefault(run.measured.run.readings_sha256, run)
        if first is not run:
            copies.append((run, f"contains the same readings as {first.measured.path}: excluded from the mean"))
    single = list(by_digest.values())
    together = max(([run for run in single if _are_same_poses(first, run)] for first in single), key=len)
    why = f"the poses are not those of {together[0].measured.path}: excluded from the mean"
    copies += [(run, why) for run in single if not any(run is kept for kept in together)]
    single = together
    balls = [run.found.distance.ball_mm for run in single if isinstance(run.found, CircleResult)]
    balls += [run.found.free.centre for run in single if isinstance(run.found, RadialResult)]
    if len(balls) < max(2, len(single)):
        return single, copies
    away = np.linalg.norm(np.array(balls) - np.median(balls, axis=0), axis=1)
    if len(single) == 2:
        if 2 * away.max() <= _TWO_MM:
            return single, copies
        why = f"the balls of the two runs lie {2 * away.max():.2f} mm apart: different set-ups do not share a mean"
        return [], [*copies, *((run, why) for run in single)]
    limit = max(BALL_ELSEWHERE_MM, _SPREADS * float(np.median(away)))
    near = [run for run, far in zip(single, away, strict=True) if far <= limit]
    others = [
        (run, f"the ball lies {far:.2f} mm from that of the other runs: another set-up, excluded from the mean")
        for run, far in zip(single, away, strict=True)
        if far > limit
    ]
    return near, [*copies, *others]


def _are_same_poses(first: Result, run: Result) -> bool:
    table, its = first.measured.table, run.measured.table
    if not (isinstance(table, PlaceTable) and isinstance(its, PlaceTable)):
        return True
    return table.q.shape == its.q.shape and float(np.abs(wrapped(table.q - its.q)).max()) < _SAME_POSE_RAD


def pairs_of(group: Sequence[Result]) -> Pairs | None:
    """Pair each acw run with the cw run of the closest ball, otherwise in the given order; None unless both exist."""
    circles = [(run, run.found) for run in group if isinstance(run.found, CircleResult)]
    acw_runs, cw_runs = ([ring for ring in circles if ring[1].laps.direction == way] for way in ("acw", "cw"))
    if not acw_runs or not cw_runs:
        return None
    runs, pairs, refused = [], [], list[str]()
    while acw_runs and cw_runs:
        acw, forth = acw_runs.pop(0)
        # Ball positions from the angle, less affected by backlash than the distance; set-up errors are common.
        offsets = [np.hypot(forth.sine.a - ring.sine.a, forth.sine.b - ring.sine.b) for _, ring in cw_runs]
        apart_mm = [forth.laps.frame.radius * float(offset) for offset in offsets]
        nearest = np.argmin([mm if mm > BALL_ELSEWHERE_MM else 0.0 for mm in apart_mm])
        cw, back = cw_runs.pop(int(nearest))
        try:
            pairs.append(pair(forth, back, f"{acw.name} and {cw.name}"))
            runs.append((acw, cw))
        except FileError as error:
            refused += error.lines()
    without = (f"no run in the other direction belongs to {run.name}" for run, _ in acw_runs + cw_runs)
    refused = [*without, *refused]
    if not pairs:
        return Pairs((), {}, None, tuple(refused))
    figures: dict[str, Quantity | BetweenRuns] = {**pairs[0].figures}
    lag = pairs[0].lag
    if len(pairs) > 1:
        figures = {**figures_between_runs([of_pair.figures for of_pair in pairs])}
        lag = figures_between_runs([{"lag_ms": of_pair.lag} for of_pair in pairs])["lag_ms"].mean
    return Pairs(tuple(runs), figures, lag, tuple(refused))


@dataclass(frozen=True)
class FigureColumn:
    """Figures by name, of the mean of `count` runs, of one `run`, or of `count` pairs of acw and cw (without
    direction).

    sd: standard deviation between runs of repeated figures.
    """

    kind: Literal["mean", "run", "pairs"]
    direction: str
    count: int
    run: str
    figures: Mapping[str, Quantity]
    sd: Mapping[str, str]


def figure_columns(group: Sequence[Result]) -> list[FigureColumn]:
    together = {mean.title: mean for mean in pooled(group) if mean.figures}
    columns = []
    for title in dict.fromkeys(result.title for result in group):
        direction = title.partition(" ")[2]
        if title in together:
            columns.append(_column("mean", direction, len(together[title].runs), together[title].figures))
        else:
            runs = [result for result in group if result.title == title]
            columns += [FigureColumn("run", direction, 1, run.name, run.figures, {}) for run in runs]
    both = pairs_of(group)
    return [*columns, _column("pairs", "", len(both.runs), both.figures)] if both and both.figures else columns


def _column(
    kind: Literal["mean", "pairs"], direction: str, count: int, of_runs: Mapping[str, Quantity | BetweenRuns]
) -> FigureColumn:
    pooled_runs = {name: figure for name, figure in of_runs.items() if isinstance(figure, BetweenRuns)}
    figures = {name: figure.mean if isinstance(figure, BetweenRuns) else figure for name, figure in of_runs.items()}
    return FigureColumn(kind, direction, count, "", figures, {name: mean.in_sd for name, mean in pooled_runs.items()})
