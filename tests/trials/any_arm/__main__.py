"""Calibrated models of arms of seven axes that others measured, at poses and placements left out of the calibration.

`scripts/dev any_arm DATA` reads `jacobi` (a Barrett WAM, a laser tracker: grid, then 20 random poses with the set-up of
the grid) and `mukca` (two Pandas and an iiwa 14, a ball in two sockets 50 mm apart: each placement left out in turn).
`--u-mm 0.05` lets the fit know the distance of the sockets with that uncertainty.
"""

from __future__ import annotations

import argparse
import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.diagnosis.diagnose import diagnose
from analysis.diagnosis.evidence.observation import residual_of
from analysis.diagnosis.evidence.prepared_runs import prepare_runs
from analysis.diagnosis.evidence.setups import fit_run_setups, with_effects
from analysis.diagnosis.judge.result import Diagnosis
from analysis.procedures.results import result_of
from analysis.procedures.shared.evaluate import evaluate
from analysis.robot.kinematics.arm import Array
from analysis.runs.loading import Measured
from analysis.runs.tables import PoseTable, TouchTable
from rigs.arms import load_arm
from rigs.effects import Effect
from rigs.load import parse
from rigs.rig import Rig
from rigs.schema.effect import name_of
from tests.worlds.arms.seven_axes import run_of

ARMS = {"panda_1": "franka-fr3", "panda_2": "franka-fr3", "kuka_14": "kuka-lbr-iiwa-14"}
"""The Panda has the lengths of the FR3; masses, which differ a little, only scale what yields."""
KNOWN_MM = 50.0


@dataclass(frozen=True)
class LeftOut:
    """What a model leaves of touches or poses that had no part in it: rms (mm) before and calibrated, and how many."""

    before_mm: float
    calibrated_mm: float
    count: int


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, help="directory with jacobi and mukca")
    parser.add_argument("--only", choices=("wam", *ARMS), help="one of the arms (all)")
    parser.add_argument("--u-mm", type=float, help="the distance of the sockets is known with this uncertainty")
    given = parser.parse_args()
    if given.only in (None, "wam"):
        _wam(given.data / "jacobi")
    for arm in ARMS:
        if given.only in (None, arm):
            _touched(arm, given.data / "mukca", given.u_mm)


def _wam(folder: Path) -> None:
    rig = parse(f"name: wam\n{load_arm('barrett-wam-7').text}  tool: {{xyz_mm: [0, 0, 44]}}\n", "wam.yaml")
    grid, judge = (run_of(rig, _tracked(folder / f"wam_{name}.csv"), name, "cell") for name in ("grid", "random"))
    start = time.process_time()
    found = diagnose(rig, [grid], [judge], [], lambda _: None)
    assert found.calibrated is not None
    effects = [*(one.effect for one in found.written), *found.calibrated.effects]
    left = _left(rig, grid, judge, effects)
    error = np.linalg.norm(left, axis=1)
    print(f"WAM, grid to random, set-up of the grid: mean {error.mean():.2f}, rms {np.sqrt(np.mean(error**2)):.2f} mm")
    print(f"  {found.condition}; grid {found.train.before_um:.0f} to {found.train.calibrated_um:.0f} µm rms; ", end="")
    print(f"{time.process_time() - start:.0f} s of CPU")
    for part in found.budget:
        print(f"  {part.kind} {part.name or part.axis or ''}: {part.um:.0f} µm rms, {part.share:.1%}")
    for effect in effects:
        if waves := getattr(effect, "waves", ()):
            size = np.sqrt(sum(amplitude**2 for _, amplitude, _ in waves) / 2)
            print(f"  curve of axis {getattr(effect, 'axis', 0)}: {size:.4f}° rms over a turn")


def _left(rig: Rig, used: Measured, judge: Measured, effects: Sequence[Effect]) -> Array:
    """What a model leaves (n, 3) mm of poses with the set-up of others."""
    (runs, judges), _ = prepare_runs(rig, [used], [judge])
    runs, judges = with_effects(runs, effects), with_effects(judges, effects)
    placed, _ = fit_run_setups(runs)
    (left,) = (residual_of(one, placed) for one in judges)
    return left


def _touched(arm: str, folder: Path, u_mm: float | None) -> None:
    known = f', distances: [{{between: ["0", "1"], distance_mm: {KNOWN_MM}, u_mm: {u_mm}}}]' if u_mm else ""
    tests = f'tests: {{touch: {{sockets: ["0", "1"]{known}}}}}\n'
    rig = parse(f"name: {arm.replace('_', '-')}\n{load_arm(ARMS[arm]).text}{tests}", "x")
    runs = [run_of(rig, table, name, name) for name, table in sorted(touches(arm, folder).items())]
    before = [result_of(run).figures["socket_distance_mm"] for run in runs]
    print(f"{arm}: {len(runs)} placements, {sum(len(run.table.q) for run in runs)} touches")
    print(
        "  sockets apart by the nominal arm: " + ", ".join(f"{one.value:.2f} ± {one.u:.2f}" for one in before) + " mm"
    )
    found: list[LeftOut] = []
    for k, judge in enumerate(runs):
        start = time.process_time()
        diagnosis = diagnose(rig, [*runs[:k], *runs[k + 1 :]], [judge], [], lambda _: None)
        found.append(_left_out(diagnosis, judge))
        apart = _distance(rig, judge, diagnosis)
        names = ", ".join(name_of(one.effect) for one in diagnosis.standing) or "-"
        print(
            f"  without {judge.run.manifest.placement:14s} {found[-1].before_mm:6.3f} to {found[-1].calibrated_mm:.3f}"
            f" mm, sockets {apart} mm apart; {diagnosis.condition}: {names}; {time.process_time() - start:.0f} s",
            flush=True,
        )
    whole = [_rms(found, key) for key in ("before_mm", "calibrated_mm")]
    print(f"  all: {whole[0]:.3f} to {whole[1]:.3f} mm rms of the ball from its socket")


def _left_out(diagnosis: Diagnosis, judge: Measured) -> LeftOut:
    gap = diagnosis.held_out
    assert gap is not None
    return LeftOut(gap.before_um / 1e3, gap.calibrated_um / 1e3, len(judge.table.q))


def _distance(rig: Rig, judge: Measured, found: Diagnosis) -> str:
    """The distance of the sockets of a placement that was left out, by the calibrated arm."""
    assert found.calibrated is not None
    effects = (*(one.effect for one in found.written), *found.calibrated.effects)
    calibrated = judge.rig.model_copy(update={"effects": effects})
    figure = evaluate(judge.table, calibrated, 0.0, "left out").figures["socket_distance_mm"]
    return f"{figure.value:.3f} ± {figure.u:.3f}"


def _rms(found: list[LeftOut], key: str) -> float:
    counts = np.array([one.count for one in found])
    return float(np.sqrt(counts @ np.array([getattr(one, key) for one in found]) ** 2 / counts.sum()))


def _tracked(path: Path) -> PoseTable:
    """Measured place = target less residual; commanded joints."""
    rows = np.genfromtxt(path, delimiter=",", names=True)
    q = np.radians(np.stack([rows[f"joint_{axis}"] for axis in range(1, 8)], axis=1))
    return PoseTable(q, np.stack([rows[f"{axis}_t"] - rows[f"{axis}_dif"] for axis in "xyz"], axis=1), None)


def touches(arm: str, folder: Path) -> dict[str, TouchTable]:
    """Touches by placement; the files have the angles alone, in rad."""
    parts: dict[str, list[tuple[str, Array]]] = defaultdict(list)
    for path in sorted(folder.glob(f"{arm}_*_hole_?.csv")):
        placement, _, hole = path.stem.removeprefix(f"{arm}_").rpartition("_hole_")
        parts[placement].append((hole, np.loadtxt(path, delimiter=",", ndmin=2)))
    return {
        placement: TouchTable(
            np.concatenate([np.full(len(q), hole) for hole, q in own]), np.concatenate([q for _, q in own])
        )
        for placement, own in parts.items()
    }


if __name__ == "__main__":
    main()
