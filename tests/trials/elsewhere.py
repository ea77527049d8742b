"""u where a model had no part, on arms that others measured: series from each other, few poses, placements left out.

`scripts/dev elsewhere DATA` calibrates each arm by the public API (tasks of the proving ground), and by touches of all
placements but one, which is given to nobody: its ball and sockets alone are fitted. Printed: the error, its ratio to
the stated u (rms) and the share within 2 u, where the runs say that u is known (`covered`), and what the ratio would be
where they do not. Nothing is tuned to any of these sets.
"""

from __future__ import annotations

import sys
import tempfile
import time
from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from analysis import calibrate
from analysis.correction.pose_uncertainty import CalibratedUncertainty, covered, frame_u_mm
from analysis.diagnosis.diagnose import diagnose
from analysis.diagnosis.evidence.observation import residual_of
from analysis.diagnosis.evidence.prepared_runs import prepare_runs
from analysis.diagnosis.evidence.setups import fit_run_setups, with_effects
from analysis.robot.kinematics.arm import Array, Mask
from analysis.runs.noise.readings import rms
from analysis.runs.tables import TouchTable
from rigs.arms import load_arm
from rigs.calibration import CalibratedModel, verdict_of
from rigs.load import parse
from rigs.rig import Rig
from tests.support.measured_series import MUKCA_ARMS, mukca
from tests.support.rates import wilson
from tests.support.trial import Trial, main, markdown
from tests.trials.ground import rig_entry as _ground_rig
from tests.trials.ground.tasks import WHOLE, Split, measured_splits
from tests.worlds.arms.seven_axes import run_of

GEN3LITE = """\
robot:
  name: gen3lite
  build: light
  axes: # the maker's gen3_lite.urdf; masses are rounded from it
    - {name: joint 1, d_mm: 243.25, limits_deg: [-175, 175], speed_deg_s: 60, mass_kg: 1.1}
    - {name: joint 2, alpha_deg: 90, offset_deg: 90, limits_deg: [-175, 175], speed_deg_s: 60, mass_kg: 1.0}
    - {name: joint 3, a_mm: 280, alpha_deg: 180, d_mm: -10, offset_deg: 90, limits_deg: [-175, 175],
       speed_deg_s: 60, mass_kg: 0.9}
    - {name: joint 4, alpha_deg: 90, d_mm: 245, offset_deg: 90, limits_deg: [-175, 175], speed_deg_s: 60, mass_kg: 0.6}
    - {name: joint 5, alpha_deg: 90, d_mm: 57, limits_deg: [-175, 175], speed_deg_s: 60, mass_kg: 0.5}
    - {name: joint 6, alpha_deg: -90, d_mm: 105, offset_deg: -90, limits_deg: [-175, 175], speed_deg_s: 60,
       mass_kg: 0.6}
"""
JUDGING = 250
"""Poses that judge a small table."""
HEAD = ("judged", "error, µm", "u is known", "error over u", "within 2 u", "where u is not known")


def draw(given: Namespace) -> Iterator[Split | tuple[str, str, Path]]:
    """Tasks of poses, or small tables of them, and arms with the placement that is left out."""
    for split in measured_splits(given.data, 0, WHOLE)[0]:
        if given.rows and split.task.name.startswith(given.only):
            yield from small_splits(split, given.rows, given.draws)
        elif not given.rows and f"{split.task.name} ".startswith(given.only):
            yield split
    for arm in () if given.rows else (*MUKCA_ARMS, "dinova_2"):
        for placement in sorted(mukca(given.data / "mukca", arm)):
            if f"{arm} {placement}".startswith(given.only):
                yield arm, placement, given.data / "mukca"


def small_splits(split: Split, rows: int, draws: int) -> Iterator[Split]:
    """Yield random tables of a long series of one placement."""
    count = len(split.given.q)
    if count < rows + JUDGING / 2 or len(np.unique(split.given.placement)) > 1:
        return
    for draw in range(draws):
        order = np.random.default_rng([rows, draw]).permutation(count)
        given, asked = (
            split.given.of(np.isin(np.arange(count), part)) for part in np.split(order[: rows + JUDGING], [rows])
        )
        task = replace(split.task, row=f"{split.task.name}, {rows} poses, draw {draw}")
        yield Split(task, split.arm, given, asked)


def judged(case: Split | tuple[str, str, Path]) -> list[str]:
    return of_series(case) if isinstance(case, Split) else of_placement(*case)


def report(rows: Sequence[list[str]]) -> str:
    return markdown(HEAD, rows)


def of_series(split: Split) -> list[str]:
    """Evaluate a task of poses: calibrate with the given poses, validate with the requested poses."""
    begin, parts = time.process_time(), []
    with tempfile.TemporaryDirectory() as work:
        rig_file = _ground_rig.write_rig(_ground_rig.rig_of(split.arm), Path(work))
        placements = np.unique(split.given.placement)
        runs = [_ground_rig.run_of(split.given, str(one), rig_file, Path(work)) for one in placements]
        found = calibrate(runs)
    assert found.calibrated is not None
    for placement in np.unique(split.asked.placement):
        asked = split.asked.of(split.asked.placement == placement)
        taught = split.given.q[split.given.placement == placement]
        places, _ = _ground_rig.predicted(found, runs[0].rig, str(placement), asked.q, taught)
        error = np.linalg.norm(places - asked.xyz_mm, axis=1)
        stated = _stated(runs[0].rig, found.calibrated, asked.q, taught, found.train.noise_floor_um)
        parts.append((error, *stated))
    return _row(split.task.row, parts, found.calibrated, begin)


def of_placement(arm: str, placement: str, folder: Path) -> list[str]:
    """Touches of one placement by the model of all others."""
    begin = time.process_time()
    tables = {name: TouchTable(*own) for name, own in mukca(folder, arm).items()}
    text = GEN3LITE if arm == "dinova_2" else load_arm(MUKCA_ARMS[arm]).text
    rig = parse(f'name: {arm.replace("_", "-")}\n{text}tests: {{touch: {{sockets: ["0", "1"]}}}}\n', "cell.yaml")
    runs = {name: run_of(rig, table, name, name) for name, table in sorted(tables.items())}
    found = diagnose(rig, [run for name, run in runs.items() if name != placement], [], [], lambda _: None)
    assert found.calibrated is not None
    (judges, _), _ = prepare_runs(rig, [runs[placement]], [])
    judges = with_effects(judges, [*(one.effect for one in found.written), *found.calibrated.effects])
    placed, _ = fit_run_setups(judges)
    left = np.concatenate([residual_of(judge, placed) for judge in judges])
    q = np.concatenate([judge.table.q[judge.rows] for judge in judges])
    stated = _stated(rig, found.calibrated, q, q, found.train.noise_floor_um)
    return _row(f"{arm}, without {placement}", [(np.linalg.norm(left, axis=1), *stated)], found.calibrated, begin)


def _stated(rig: Rig, calibrated: CalibratedModel, q: Array, taught: Array, noise_um: float) -> tuple[Array, Mask]:
    """The model's u (n,) mm of the distance, with frame and tool taught, and where the runs say that it is known."""
    uncertainty = CalibratedUncertainty(rig, calibrated)
    inside = covered(uncertainty, q)
    assert inside is not None
    return np.hypot(frame_u_mm(rig, uncertainty, q, taught), noise_um / 1e3), inside


def _row(what: str, parts: list[tuple[Array, Array, Mask]], calibrated: CalibratedModel, begin: float) -> list[str]:
    error, u, inside = (np.concatenate([part[k] for part in parts]) for k in range(3))
    within = int((error[inside] <= 2 * u[inside]).sum())
    low, high = wilson(within, int(inside.sum())) if inside.any() else (0.0, 1.0)
    shown = f"{rms(error[inside] / u[inside]):.2f}" if inside.any() else "–"
    share = f"{within / inside.sum():.0%} ({low:.0%} to {high:.0%})" if inside.any() else "–"
    beyond = f"{rms(error[~inside] / u[~inside]):.2f}" if not inside.all() else "–"
    if verdict_of(calibrated) == "nothing":
        beyond += ", correct nothing"
    print(
        f"{what}: {time.process_time() - begin:.0f} s of CPU, reach {calibrated.reach_mm} mm",
        file=sys.stderr,
        flush=True,
    )
    return [what, f"{1e3 * rms(error):.0f}", f"{inside.sum()} of {len(error)}", shown, share, beyond]


TRIAL = Trial(
    draw,
    judged,
    report,
    options={
        "DATA": (Path, "directory with ipa-ur10, jacobi and mukca"),
        "only": ("", "what begins so, as 'ur10-b ' or 'panda_2 high' (all)"),
        "rows": (0, "random tables of so many poses of each series, judged by 250 others"),
        "draws": (3, "random tables of each series (3)"),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
