"""A cell with a reference of touches, and touches after something moved, by an independent world."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from analysis.api import read_table, save_run
from tests.trials.moved.__main__ import Case
from tests.worlds import moved as world


def moved_cell(folder: Path, cause: str, seed: int = 2, scatter_mm: float = 0.05) -> Case:
    """Write the rig file and the run `before` of a cell in which a cause then moves something."""
    case = Case(world.SIX, cause, scatter_mm, seed)
    (folder / "cell.yaml").write_text(case.rig_text, encoding="utf-8")
    write_touches(folder, "before", case.sockets, case.before)
    return case


def write_touches(folder: Path, name: str, sockets: list[str], q: np.ndarray) -> Path:
    """Write touches as a table and as a run in `folder/runs`."""
    head = ",".join(["socket", *(f"q{k}_deg" for k in range(1, q.shape[1] + 1))])
    rows = [",".join([s, *(f"{a:.6f}" for a in np.degrees(row))]) for s, row in zip(sockets, q, strict=True)]
    table = folder / f"{name}.csv"
    table.write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    (folder / "runs").mkdir(exist_ok=True)
    return save_run(read_table(table, folder / "cell.yaml", "touch"), folder / "runs" / name)


def touch_near(case: Case, joints_deg: list[float]) -> np.ndarray:
    """Return the joint angles in degrees of a touch after the movement, near a proposed posture of the reference."""
    row = int(np.abs(case.before - np.radians(joints_deg)).max(axis=1).argmin())
    _, q = case.touch([case.sockets[row]], case.q[row : row + 1])
    return np.asarray(np.degrees(q[0]))
