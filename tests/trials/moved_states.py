"""Runs of one arm in several states: each change between runs is found with its size, and one state is kept.

`scripts/dev moved_states` simulates two to five tracker runs of two arms with
independent kinematics, healthy link errors and gear waves. Before each later run, nothing, one zero, two zeros (a
homing), or the base moves. Printed: right cells, missing changes, false changes, sizes beyond 3 u, and the time.
"""

from __future__ import annotations

import sys
import time
from argparse import Namespace
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from analysis.movement.between import without_moved
from analysis.runs.loading import Measured
from rigs.load import load
from tests.support.pose_runs import pose_run
from tests.support.trial import Trial, main, seeds
from tests.worlds.arms.independent_arm import GEAR_RAD, HEALTHY, POSTURE_DEG, constants_of, flange, none

ARMS = ("ur10e", "paper-fanuc")
KINDS = ("nothing", "zero", "homing", "base")
TOOL_MM, REACH_RAD = np.array([40.0, 25.0, 130.0]), np.array([1.2, 0.5, 0.6, 1, 1, 2])
ZERO_DEG, BASE_MM, BASE_RAD = (0.06, 0.2), (0.4, 1.5), 0.5e-3
"""Ranges of a zero and a base that move: some tenths of a millimetre to some millimetres at the tool."""


@dataclass(frozen=True)
class Cell:
    """Runs in time order, and the zeros in degrees by axis, the base (axis 0) or the tool (axis 7) in mm, that changed
    before each."""

    runs: list[Measured]
    changes: list[dict[int, float]]


def drawn_cell(arm: str, kind: str, seed: int) -> Cell:
    """Draw the changes of a kind, an arm and a tracker."""
    rng = np.random.default_rng([53, seed, *arm.encode(), *kind.encode()])
    changes: list[dict[int, float]] = [{}]
    for _ in range(int(rng.integers(1, 5))):
        axes = rng.choice(np.arange(1, 7), 2 if kind == "homing" else 1, replace=False).tolist()
        drawn = {axis: float(rng.uniform(*ZERO_DEG) * rng.choice([-1, 1])) for axis in axes}
        changes.append({"nothing": {}, "base": {0: float(rng.uniform(*BASE_MM))}}.get(kind, drawn))
    return cell_with(arm, changes, rng)


def cell_with(arm: str, changes: list[dict[int, float]], rng: np.random.Generator) -> Cell:
    """Simulate a run after each of the given changes."""
    wrong = replace(none(), **{name: rng.normal(0, sd, 6) for name, sd in HEALTHY.items()})
    wrong = replace(wrong, sine=rng.normal(0, GEAR_RAD, (6, 2)), cosine=rng.normal(0, GEAR_RAD, (6, 2)))
    place, noise_mm = rng.normal(0, 1500, 3), rng.uniform(0.01, 0.05)
    turn, tool, runs = np.eye(3), TOOL_MM, []
    for number, change in enumerate(changes, start=1):
        zero = [np.radians(change.get(axis, 0.0)) for axis in range(1, 7)]
        wrong = replace(wrong, offset=wrong.offset + zero)
        if 0 in change:
            shift = rng.normal(size=3)
            place = place + shift / np.linalg.norm(shift) * change[0]
            turn = Rotation.from_rotvec(rng.normal(0, BASE_RAD, 3)).as_matrix() @ turn
        if 7 in change:
            shift = rng.normal(size=3)
            tool = tool + shift / np.linalg.norm(shift) * change[7]
        q = np.radians(POSTURE_DEG[arm]) + rng.uniform(-1, 1, (int(rng.integers(25, 60)), 6)) * REACH_RAD
        R, p = flange(constants_of(arm), wrong, q)
        xyz = (p + R @ tool) @ turn.T + place
        runs.append(pose_run(arm, q, xyz + rng.normal(0, noise_mm, xyz.shape), f"run {number}"))
    return Cell(runs, changes)


def judged(cell: Cell, arm: str) -> dict[str, int]:
    """Count the changes that are missing, false, or of a wrong size, and states that were mixed."""
    rig = load(arm)[0].model_copy(update={"effects": ()})
    kept, movements, _ = without_moved(rig, cell.runs)
    names = [run.run.manifest.name for run in cell.runs]
    found: dict[tuple[str, int], tuple[float | None, float | None]] = {}
    for one in movements:
        axis = one.axis if one.axis is not None else {"tool": 6}.get(one.what, 0)
        found[one.to, axis] = one.size_deg, one.u_deg
    changes = list(zip(names, cell.changes, strict=True))
    true = {(name, axis): size for name, change in changes for axis, size in change.items()}
    wrong = sum(
        size is not None and u is not None and abs(size - true[key]) > 3 * u
        for key, (size, u) in found.items()
        if key in true
    )
    starts = [names.index(name) for name, change in changes if change.keys() - {0}]
    states = {sum(names.index(run.run.manifest.name) >= start for start in starts) for run in kept}
    return {
        "missing": len(true.keys() - found.keys()), "false": len(found.keys() - true.keys()), "size": wrong,
        "mixed": len(states) - 1,
    }  # fmt: skip


Result = tuple[str, str, dict[str, int], int, float]


def draw(given: Namespace) -> Iterator[tuple[str, str, int]]:
    yield from ((arm, kind, seed) for arm in ARMS for kind in KINDS for seed in seeds(given))


def counted(case: tuple[str, str, int]) -> Result:
    """Arm, kind, the counts of wrong answers, the number of changes, and the processor time in s."""
    begin, cell = time.process_time(), drawn_cell(*case)
    answer = judged(cell, case[0])
    return *case[:2], answer, sum(map(len, cell.changes)), time.process_time() - begin


def report(done: Sequence[Result]) -> str:
    lines = []
    for arm, kind in dict.fromkeys(one[:2] for one in done):
        own = [one[2:] for one in done if one[:2] == (arm, kind)]
        counts = sum((Counter(answer) for answer, *_ in own), Counter[str]())
        right = sum(not any(answer.values()) for answer, *_ in own)
        changes, seconds = sum(n for _, n, _ in own), np.mean([s for *_, s in own])
        lines.append(
            f"{arm:12s} {kind:8s} {right} of {len(own)} right, {changes} changes, {dict(counts)}, {seconds:.1f} s"
        )
    return "\n".join(lines)


TRIAL = Trial(
    draw,
    counted,
    report,
    line=lambda one: "",
    count=4,
    seed=300,
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
