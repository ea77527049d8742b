"""Conventions: false alarms in sound cells of arms from outside, and broken ones told rightly, wrongly or not."""

from __future__ import annotations

import argparse
import csv
from collections import Counter
from pathlib import Path

import numpy as np

from analysis.procedures.checks.check_runs import findings_of
from analysis.runs.loading import Measured
from analysis.runs.tables import PoseTable
from rigs.arms import load_arm
from rigs.load import load, parse
from rigs.rig import Rig
from tests.support.conventions import BREAKS, driven_on_from, is_right, run_of, sound
from tests.worlds.arms.seven_axes import run_of as touched_run

DATA = Path(__file__).parents[4] / "shared" / "data"
"""Where the measured data lie unless another folder is given; they are not part of the project."""


def real(folder: Path) -> dict[str, list[str]]:
    """What is found in the poses of real arms: a UR10 twice (Fraunhofer IPA) and a UR5 (P. Jacobi), by name."""
    from tests.trials.ur10.__main__ import read  # noqa: PLC0415

    found = {}
    for series in ("b", "d"):
        if (path := folder / "ipa-ur10" / f"series_{series}.csv").is_file():
            found[f"UR10, series {series}"] = run_of(read(path), series, load("ur10")[0])
    for name in ("ur5_grid", "ur5_random"):
        if (path := folder / "jacobi" / f"{name}.csv").is_file():
            found[f"UR5, {name[4:]}"] = run_of(_jacobi(path), name, _ur5())
    found |= _touched(folder / "mukca")
    return {name: [finding.words for finding in findings_of([run])] for name, run in found.items()}


def _touched(folder: Path) -> dict[str, Measured]:
    """Touches of two Pandas and an iiwa 14 (Franzese and others, TU Delft), all placements of an arm as one run."""
    from tests.trials.any_arm.__main__ import ARMS, touches  # noqa: PLC0415

    found = {}
    for arm, model in ARMS.items():
        rig = parse(f"name: arm\n{load_arm(model).text}", model)
        for name, table in sorted(touches(arm, folder).items()) if folder.is_dir() else ():
            found[f"{model}, {arm}, {name}"] = touched_run(rig, table, name, name)
    return found


def _ur5() -> Rig:
    """The UR5 by its maker's constants, those of a UR10 in their place."""
    rig = load("ur10")[0]
    lengths = zip((0, 0, -425, -392.25, 0, 0), (89.159, 0, 0, 109.15, 94.65, 82.3), (0, 90, 0, 0, 90, -90), strict=True)
    axes = tuple(
        axis.model_copy(
            update={"a_mm": float(a), "d_mm": d, "alpha_deg": float(alpha), "beta_deg": 0.0, "offset_deg": 0.0}
        )
        for axis, (a, d, alpha) in zip(rig.robot.axes, lengths, strict=True)
    )
    return rig.model_copy(update={"robot": rig.robot.model_copy(update={"axes": axes})})


def _jacobi(path: Path) -> PoseTable:
    with path.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    q = np.radians([[float(row[f"joint_{k}"]) for k in range(1, 7)] for row in rows])
    xyz = np.array([[float(row[f"{axis}_t"]) - float(row[f"{axis}_dif"]) for axis in "xyz"] for row in rows])
    return PoseTable(q, xyz, None)


def main() -> None:
    parser = argparse.ArgumentParser(prog="scripts/dev conventions", description=__doc__)
    parser.add_argument("--sound", type=int, default=70, help="sound cells (70: some 300 runs)")
    parser.add_argument("--driven", type=int, default=30, help="sound cells that drive cw on from acw (30: 120 runs)")
    parser.add_argument("--each", type=int, default=20, help="cells of each kind with one convention broken (20)")
    parser.add_argument("--seed", type=int, default=0, help="of the first cell (0)")
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the measured data (../shared/data)")
    given = parser.parse_args()
    runs = alarms = 0
    cells = [(sound, number) for number in range(given.sound)]
    cells += [(driven_on_from, number) for number in range(given.driven)]
    for make, number in cells:
        cell = make(number, given.seed)
        runs += len(cell)
        found = findings_of(cell)
        alarms += bool(found)
        for finding in found:
            print(
                f"  false, {make.__name__} {number}, {', '.join(finding.runs)}: {finding.convention}: {finding.words}"
            )
    print(f"sound: {runs} runs of {len(cells)} cells, {alarms} cells with a false alarm")
    for name, said in real(given.data).items():
        print(f"real: {name}: {'; '.join(said) or 'nothing found'}")
    print(f"{'broken':36}{'cells':>6}{'right':>6}{'wrong':>6}{'not':>5}")
    for kind, (name, make) in enumerate(BREAKS.items()):
        told = Counter[str]()
        for number in range(given.each):
            broken = make(np.random.default_rng([given.seed, kind, number, 2]), number)
            found = findings_of(broken.runs)
            right = any(is_right(finding, broken) for finding in found)
            wrong = [finding for finding in found if finding.strength != "likely" and not is_right(finding, broken)]
            verdict = "right" if right else "wrong" if wrong else "not"
            told[verdict] += 1
            if verdict != "right":
                said = "; ".join(finding.words for finding in found) or "nothing"
                print(f"  {name}, cell {number}, meant {broken.meant[0]!r} in {broken.runs[0].title}: {said}")
        print(f"{name:36}{given.each:6}{told['right']:6}{told['wrong']:6}{told['not']:5}", flush=True)


if __name__ == "__main__":
    main()
