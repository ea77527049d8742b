"""How well figures agree with what was planted: share within 2 u, width of u, bias; and the verdict on them.

The rules: over cells drawn from the table 90 to 99 % lie within 2 u, and for each single kind of noise 90 % at least;
u is at most 2.5 times the rms error where laps or visits were repeated; the mean error is at most 0.3 of the mean u. A
figure whose noise is assumed is exempt from width and bias.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from zlib import crc32

import numpy as np

from rigs.errors import FileError
from tests.worlds.planted import circles, poses, targets
from tests.worlds.planted.cells import SINGLE
from tests.worlds.planted.circles import Outcome, Size

TABLE = "table"
LEAST, LEAST_OF_KIND, MOST, WIDEST, BIAS = 0.90, 0.90, 0.99, 2.5, 0.3

Case = Callable[[np.random.Generator, str, Size], Outcome]
CASES: dict[str, tuple[Case, tuple[str, ...]]] = {
    "yaw": (circles.yaw_case, tuple(SINGLE)),
    "roll": (circles.roll_case, tuple(SINGLE)),
    "radial": (targets.radial_case, tuple(targets.SINGLE)),
    "repeatability": (targets.repeatability_case, tuple(targets.SINGLE)),
    "pose": (poses.pose_case, tuple(poses.SINGLE)),
    "repeated": (circles.repeated_case, ("white", "AR .995")),
}
"""Each with the single kinds of noise that it knows. Circularity and pairs come with yaw."""
CIRCLES = ("yaw", "roll", "repeated")
"""Tests whose laps have rows."""


@dataclass(frozen=True)
class Job:
    """One planted case: a test in a cell of a kind, with laps (or visits) of so many rows."""

    test: str
    kind: str
    seed: int
    laps: int
    rows: int


@dataclass(frozen=True)
class Point:
    """One figure of one case. error: reported less true; noise: where its noise comes from."""

    test: str
    figure: str
    kind: str
    error: float
    u: float
    noise: str


def points_of(job: Job) -> list[Point]:
    """Every figure of a case. A run that is refused, a figure left out and one without u have an error of nan."""
    case, _ = CASES[job.test]
    # The same cell whatever the laps and rows, so that their tables compare.
    rng = np.random.default_rng([job.seed, crc32(job.kind.encode()), crc32(job.test.encode())])
    try:
        outcome = case(rng, job.kind, Size(job.laps, job.rows))
    except FileError:
        return [Point(job.test, "(run refused)", job.kind, np.nan, np.nan, "")]
    except Exception as error:
        error.add_note(f"planted case: {job}")
        raise
    return [
        _point(test, name, job.kind, figures.get(name), truth.get(name, np.nan))
        for test, (figures, truth) in outcome.items()
        for name in dict.fromkeys((*truth, *figures))
    ]


def _point(test: str, name: str, kind: str, figure: circles.Quantity | None, truth: float) -> Point:
    if figure is None or not np.isfinite(figure.u):
        return Point(test, name, kind, np.nan, np.nan, "")
    error = figure.value - truth
    if name.endswith(("_at_deg", "shift_deg")):
        error = (error + 180) % 360 - 180
    return Point(test, name, kind, float(error), float(figure.u), figure.noise)


@dataclass(frozen=True)
class Score:
    """Of one figure in one kind of noise. missing: cases in which it was left out or had no u; width: mean u over rms
    error; bias: mean error over mean u; assumed: share of cases whose noise was assumed."""

    test: str
    figure: str
    kind: str
    count: int
    missing: int
    within: float
    width: float
    bias: float
    assumed: float

    def faults(self, repeated: bool) -> list[str]:
        """What the rules find wrong; repeated: laps or visits were. A figure may be left out, so that is no fault."""
        if not self.count:
            return []
        least = LEAST if self.kind == TABLE else LEAST_OF_KIND
        found = [f"{self.kind}: {100 * self.within:.0f} % within 2 u"] if self.within < least else []
        if self.kind != TABLE:
            return found
        if self.within > MOST:
            found.append(f"{self.kind}: {100 * self.within:.0f} % within 2 u")
        if self.assumed < 0.5:
            found += [f"u {self.width:.1f} times the rms error"] if repeated and self.width > WIDEST else []
            found += [f"bias {self.bias:+.2f} u"] if abs(self.bias) > BIAS else []
        return found


def scores_of(points: Iterable[Point]) -> list[Score]:
    """Scores by test, figure and kind of noise, in order of first appearance."""
    groups: dict[tuple[str, str, str], list[Point]] = defaultdict(list)
    for point in points:
        groups[point.test, point.figure, point.kind].append(point)
    return [_score(*key, group) for key, group in groups.items()]


def _score(test: str, figure: str, kind: str, points: Sequence[Point]) -> Score:
    every = np.array([(point.error, point.u) for point in points])
    error, u = every[np.isfinite(every).all(axis=1)].T
    missing = len(points) - len(error)
    if not len(error):
        return Score(test, figure, kind, 0, missing, np.nan, np.nan, np.nan, np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        width, bias = np.mean(u) / np.sqrt(np.mean(error**2)), np.mean(error) / np.mean(u)
    assumed = np.mean([point.noise == "assumed" for point in points if np.isfinite(point.error)])
    within = np.mean(np.abs(error) <= 2 * u)
    return Score(test, figure, kind, len(error), missing, *map(float, (within, width, bias, assumed)))


# --- what is printed


def report(scores: Sequence[Score], repeated: bool) -> str:
    """A table for each test: per cent within 2 u by kind of noise, then width, bias and source of the first kind, and
    how often the figure was missing; and the verdict."""
    lines, faults, unscored, figures = [], [], [], 0
    for test in dict.fromkeys(score.test for score in scores):
        kinds = list(dict.fromkeys(score.kind for score in scores if score.test == test))
        # Of two runs Student's factor alone is seven, so the width of their mean says nothing of the noise.
        narrow = repeated and not test.endswith(" runs")
        lines += ["", f"| {test} | {' | '.join(kinds)} | u/rms | bias | assumed | missing |"]
        lines.append("| --- " * (len(kinds) + 5) + "|")
        for figure in dict.fromkeys(score.figure for score in scores if score.test == test):
            of_figure = {score.kind: score for score in scores if (score.test, score.figure) == (test, figure)}
            if not any(score.count for score in of_figure.values()):
                unscored.append(f"{test} {figure} (cells: {sum(score.missing for score in of_figure.values())})")
                continue
            lines.append(_line(figure, kinds, of_figure))
            wrong = [fault for score in of_figure.values() for fault in score.faults(narrow)]
            faults += [f"  {test} {figure}: {'; '.join(wrong)}"] if wrong else []
            figures += 1
    verdict = [f"{figures - len(faults)} of {figures} figures keep the rules"]
    verdict += [f"without a value, a u or a planted truth in every cell: {', '.join(unscored)}"] if unscored else []
    return "\n".join([*lines, "", *faults, *verdict])


def _line(figure: str, kinds: Sequence[str], of_figure: dict[str, Score]) -> str:
    scored = {kind: score for kind, score in of_figure.items() if score.count}
    within = [f"{100 * scored[kind].within:.0f}" if kind in scored else "-" for kind in kinds]
    first = next(iter(scored.values()))
    missing = sum(score.missing for score in of_figure.values())
    rest = f"{first.width:.2f} | {first.bias:+.2f} | {100 * first.assumed:.0f} % | {missing}"
    return f"| {figure} | {' | '.join(within)} | {rest} |"


def as_json(scores: Sequence[Score], laps: int, rows: int) -> list[dict[str, object]]:
    """Scores as plain objects, nan as None."""
    plain = [asdict(score) | {"laps": laps, "rows": rows} for score in scores]
    return [{key: None if value != value else value for key, value in one.items()} for one in plain]  # noqa: PLR0124
