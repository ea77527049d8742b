"""rig in the proving ground: reads the tasks (docs/how-to/enter-the-proving-ground.md), answers by the public API.

Poses are answered by the calibrated model, with the set-up that `calibrate` fitted; u is that of the model with frame
and target taught at the poses given, and the noise of the readings.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from analysis import Diagnosis, Measured, RigError, calibrate, read_table
from analysis.correction.pose_uncertainty import PoseUncertainty, frame_u_mm, where_known
from analysis.procedures.shared.test_kind import path_of, predict
from analysis.robot.predict import SetUp, model_of
from analysis.runs.tables import PoseTable
from rigs.load import load
from rigs.rig import Rig
from tests.trials.ground.plain_arm import (
    XYZ,
    Array,
    PlainArm,
    Poses,
    joints,
    read_arm,
    read_poses,
    write_answer,
    write_rows,
)
from tests.trials.ground.tasks import read_tasks

TEMPLATE = "ur10-cell"
"""A shipped rig file, of which everything but the arm stays: it has no part in poses."""
SPEED_DEG_S = 120


def answered(tasks: Path, answers: Path) -> None:
    """Answer every task that rig can enter and has not answered, and say how long each took and which it cannot."""
    for task in read_tasks(tasks):
        if (answers / f"{task.name}.csv").exists():
            continue
        begin = time.process_time()
        try:
            with tempfile.TemporaryDirectory(prefix="ground-") as work:
                answer(tasks / task.name, answers / f"{task.name}.csv", Path(work))
        except RigError as error:
            print(f"rig: {task.name}: {error}", flush=True)
            continue
        print(f"rig: {task.name}, {time.process_time() - begin:.1f} s", flush=True)


def answer(here: Path, path: Path, work: Path) -> None:
    arm, given, asked = read_arm(here / "arm.csv"), *(read_poses(here / f"{one}.csv") for one in ("train", "test"))
    write_answer(path, *placed(arm, given, asked, work))


def placed(arm: PlainArm, given: Poses, asked: Poses, work: Path) -> tuple[Array, Array]:
    """Places (m, 3) mm of the poses asked, and u (m,) mm of each distance."""
    rig_file = work / "cell.yaml"
    rig_file.write_text(yaml.safe_dump(rig_of(arm)), encoding="utf-8")
    runs = [run_of(given, str(placement), rig_file, work) for placement in np.unique(given.placement)]
    found = calibrate(runs)
    places, u = np.zeros((len(asked.q), 3)), np.zeros(len(asked.q))
    for placement in np.unique(asked.placement):
        there = asked.placement == placement
        taught = given.q[given.placement == placement]
        places[there], u[there] = predicted(found, runs[0].rig, str(placement), asked.q[there], taught)
    return places, u


def rig_of(arm: PlainArm) -> dict[str, Any]:
    data: dict[str, Any] = yaml.safe_load(load(TEMPLATE)[1])
    for own in ("gauges", "feedback", "tests"):  # of an arm with six axes
        data.pop(own, None)
    angles = np.degrees([arm.alpha, arm.offset])
    data["robot"] |= {
        "axes": [
            {
                "name": f"axis {k + 1}",
                "a_mm": float(arm.a[k]),
                "alpha_deg": float(angles[0, k]),
                "d_mm": float(arm.d[k]),
                "offset_deg": float(angles[1, k]),
                "mass_kg": float(arm.mass[k]),
                "centre_mm": arm.centre[k].tolist(),
                "limits_deg": [-720, 720],
                "speed_deg_s": SPEED_DEG_S,
            }
            for k in range(arm.axes)
        ],
        "tool": {"xyz_mm": [0, 0, 0]},
    }
    return data


def run_of(given: Poses, placement: str, rig_file: Path, work: Path) -> Measured:
    of = given.of(given.placement == placement)
    table = work / f"{placement}.csv"
    rows = np.column_stack([np.degrees(of.q), of.xyz_mm])
    names = (*joints(of.q.shape[1]), *XYZ)
    write_rows(table, names, [[f"{value:.6f}" for value in row] for row in rows])
    return read_table(table, rig_file, "pose", placement=placement)


def predicted(found: Diagnosis, rig: Rig, placement: str, q: Array, taught: Array) -> tuple[Array, Array]:
    """Return where the instrument of a placement sees its target (m, 3) mm at joint angles q (m, 6) rad by what was
    found, and u (m,) mm, NaN where it is not known; taught (k, 6) rad: the poses by which its frame is known."""
    model = model_of(rig, [*rig.effects, *(one.effect for one in found.standing), *found.calibrated.effects])
    placed_at = next(one for name, one in found.calibrated.setups.items() if name.endswith(f"at {placement}"))
    instrument, target = (np.array(T) for T in (placed_at.T_instrument_world, placed_at.T_tool_target))
    setup = SetUp(np.zeros(3), np.zeros(1), instrument, target)
    table = PoseTable(q, np.zeros((len(q), 3)), None)
    places = predict(model, table, path_of(model, table), setup).reshape(-1, 4, 4)[:, :3, 3]
    known = PoseUncertainty(rig, found.calibrated)
    noise = 1e-3 * found.train.noise_floor_um
    return places, where_known(known, q, np.hypot(frame_u_mm(rig, known, q, taught), noise))


if __name__ == "__main__":
    answered(Path(sys.argv[1]), Path(sys.argv[2]))
