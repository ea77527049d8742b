"""Stated probabilities of features against measured arms: `scripts/dev certify DATA 4`.

A calibration uses some poses of a public series. Features of poses that were left out, single positions and distances
of a pose to another and to a line of two, get the tolerance at which rig states a probability. The measured share
inside must be that probability. Frame and tool are taught at the poses used. Programs of two targets whose measured
positions are bad and distance is good, or the reverse, count the verdicts.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.apps.certify.features import Feature
from analysis.apps.certify.target_errors import Work, causes_of
from analysis.correction.pose_uncertainty import covered, pose_uncertainty
from analysis.correction.support import supports
from analysis.correction.work import rest_moves_mm
from analysis.robot.geometry.pose_setup import fit_setup
from analysis.robot.kinematics.arm import arm_of, forward
from analysis.runs.tables import PoseTable
from rigs.arms import load_arm
from rigs.load import parse
from tests.support.measured_series import jacobi, ur10
from tests.support.pose_runs import calibrated, with_tool
from tests.support.trial import Trial, main, markdown, seeds
from tests.worlds.arms.seven_axes import run_of

Array = NDArray[np.float64]
STATED = np.array([0.1, 0.3, 0.5, 0.7, 0.9])
FEATURES, FEWEST_APART_MM, DRAWN = 300, 50.0, 2000
"""Features of a kind in a draw, smallest distance of a pair, and draws of the errors of a feature."""
TOLERANCE_MM = 0.3
"""Tolerance of a constructed program. Its bad errors exceed twice this, its good ones half of it."""
POOLS = {
    "UR10 B": ("ipa-ur10/series_b.csv", "ur10", (40, 200)),
    "UR10 D": ("ipa-ur10/series_d.csv", "ur10", (40, 200)),
    "UR5": ("jacobi/ur5_grid.csv", "ur5", (40, 200)),
    "WAM": ("jacobi/wam_grid.csv", "barrett-wam-7", (60, 120)),
}
"""File, arm of the library, and numbers of poses used."""
KINDS = {"position": 1, "distance": 2, "distance to a line": 3}
"""Number of targets of each kind of feature."""


@dataclass(frozen=True)
class Judged:
    """A feature: kind with state, drawn errors (d,), measured error, and measured displacements (m, 3), in mm."""

    kind: str
    drawn: Array
    measured: float
    moves: Array

    def verdict(self, tolerance_mm: float) -> str:
        inside = np.mean(self.drawn <= tolerance_mm)
        return "accepted" if inside >= 0.95 else "rejected" if inside <= 0.05 else "undecided"


def pool_of(data: Path, name: str) -> tuple[Array, Array]:
    file = data / POOLS[name][0]
    return ur10(file) if file.parent.name == "ipa-ur10" else jacobi(file)


def rig_text(name: str) -> str:
    tool = "  tool: {xyz_mm: [0, 0, 44]}\n" if name == "WAM" else ""
    return f"name: arm\n{load_arm(POOLS[name][1]).text}{tool}"


def features(name: str, q: Array, xyz_mm: Array, count: int, rng: np.random.Generator) -> Iterator[Judged]:
    """Features of the poses that a calibration by `count` poses has not seen."""
    order, text = rng.permutation(len(q)), rig_text(name)
    used, out = np.sort(order[:count]), order[count:]
    rig = calibrated([run_of(parse(text, "cell.yaml"), PoseTable(q[used], xyz_mm[used], None), "used", "cell")], text)
    setup = fit_setup(forward(arm_of(rig.robot), q[used]), xyz_mm[used])
    rig = rig if name == "WAM" else with_tool(rig, setup.T_flange_tool[:3, 3])
    inside, arm = covered(pose_uncertainty(rig, supports(rig)), q[out]), arm_of(rig.robot)
    out = out[inside] if inside is not None else out
    if len(out) < max(KINDS.values()):
        return  # rig advises against this model, and states no probability
    wanted, taught = forward(arm, q[out]), (q[used], forward(arm, q[used]))
    to_base = np.linalg.inv(setup.T_world_base)
    seen = xyz_mm @ to_base[:3, :3].T + to_base[:3, 3]
    measured = rest_moves_mm(seen[out], wanted, (seen[used], taught[1]))
    work = Work(q[out], wanted, np.full_like(q[out], np.nan), np.full(len(out), np.nan))
    causes = causes_of(rig, work, taught, load_arm(POOLS[name][1]).repeatability_mm)
    mean = sum(cause.mean for cause in causes if cause.nature == "correctable")
    for kind, targets in KINDS.items():
        for _ in range(FEATURES):
            rows = rng.choice(len(out), targets, replace=False)
            nominal = wanted[rows, :3, 3]
            if targets > 1 and np.linalg.norm(nominal[0] - nominal[1:], axis=1).min() < FEWEST_APART_MM:
                continue
            feature = Feature(kind, "position" if targets == 1 else "distance", 1.0, rows)
            drawn = sum(cause.draw(rows, DRAWN, rng) for cause in causes)
            for state, shift in (("now", np.zeros_like(nominal)), ("corrected", mean[rows])):
                values = np.abs(feature.values(nominal, nominal + drawn - shift))
                moves = measured[rows] - shift
                error = abs(float(feature.values(nominal, (nominal + moves)[None])[0]))
                yield Judged(f"{kind}, {state}", values, error, moves)


def constructed(found: Sequence[Judged]) -> Counter[tuple[str, str]]:
    """Verdicts on the distance of two targets whose measured positions are bad and distance is good, or the reverse."""
    verdicts: Counter[tuple[str, str]] = Counter()
    for one in found:
        sizes = np.linalg.norm(one.moves, axis=1)
        if sizes.min() > 2 * TOLERANCE_MM and one.measured < TOLERANCE_MM / 2:
            verdicts["bad positions, good distance", one.verdict(TOLERANCE_MM)] += 1
        if sizes.max() < 4 * TOLERANCE_MM and one.measured > 2 * TOLERANCE_MM:
            verdicts["better positions, bad distance", one.verdict(TOLERANCE_MM)] += 1
    return verdicts


def brier(found: Sequence[Judged], rng: np.random.Generator) -> list[tuple[float, float]]:
    """Squared errors of the probabilities by rig, and by one distribution for all features of the kind, with tolerances
    drawn around the expected errors."""
    middle = np.sqrt(np.mean([np.mean(one.drawn**2) for one in found]))
    pooled = np.sort(np.concatenate([one.drawn[:200] for one in found]))
    scores = []
    for one, tolerance in zip(found, middle * rng.uniform(0.2, 2.0, len(found)), strict=True):
        by_rig, by_one = np.mean(one.drawn <= tolerance), np.searchsorted(pooled, tolerance) / len(pooled)
        is_inside = one.measured <= tolerance
        scores.append((float((is_inside - by_rig) ** 2), float((is_inside - by_one) ** 2)))
    return scores


Case = tuple[str, int, int, Path]
Result = tuple[str, dict[str, list[Array]], dict[str, list[tuple[float, float]]], Counter[tuple[str, str]]]


def draw(given: Namespace) -> Iterator[Case]:
    for name, (_, _, counts) in POOLS.items():
        if name.startswith(given.only):
            yield from ((name, count, seed, given.data) for count in counts for seed in seeds(given))


def judge(case: Case) -> Result:
    name, count, seed, data = case
    rng = np.random.default_rng(seed)
    of_kind: dict[str, list[Judged]] = defaultdict(list)
    for one in features(name, *pool_of(data, name), count, rng):
        of_kind[one.kind].append(one)
    inside = {kind: [one.measured <= np.quantile(one.drawn, STATED) for one in rows] for kind, rows in of_kind.items()}
    scores = {kind: brier(rows, rng) for kind, rows in of_kind.items()}
    return f"{name}, {count}", inside, scores, constructed(of_kind["distance, now"])


def shares(rows: Sequence[Array]) -> str:
    return ", ".join(f"{100 * share:.1f}" for share in np.mean(rows, axis=0))


def line(result: Result) -> str:
    return f"{result[0]}: " + "; ".join(f"{kind} {shares(rows)}" for kind, rows in result[1].items())


def report(done: Sequence[Result]) -> str:
    rows: dict[tuple[str, str], list[Array]] = defaultdict(list)
    scores: dict[str, list[tuple[float, float]]] = defaultdict(list)
    verdicts: Counter[tuple[str, str]] = Counter()
    for name, inside, of_kind, programs in done:
        verdicts.update(programs)
        for kind, of_rows in inside.items():
            rows[name, kind] += of_rows
            rows["all", kind] += of_rows
            scores[kind] += of_kind[kind]
    cells = [[name, kind, str(len(of_rows)), shares(of_rows)] for (name, kind), of_rows in sorted(rows.items())]
    table = markdown(("series, poses used", "features", "number", "inside of stated 10, 30, 50, 70, 90 %"), cells)
    means = {kind: np.mean(of_kind, axis=0) for kind, of_kind in scores.items()}
    lines = [f"{kind}: Brier score {by_rig:.4f}, with one u {by_one:.4f}" for kind, (by_rig, by_one) in means.items()]
    lines += [f"{program}: {verdict} {count}" for (program, verdict), count in sorted(verdicts.items())]
    return "\n".join([table, *lines])


TRIAL = Trial(
    draw,
    judge,
    report,
    line,
    count=4,
    options={"DATA": (Path, "directory with ipa-ur10 and jacobi"), "only": ("", "series whose name begins so (all)")},
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
