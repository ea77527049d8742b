"""What the robot reported in a run, whatever its gauges read: all that is needed to find where it drove."""

from __future__ import annotations

from dataclasses import dataclass

from analysis.kinematics.arm import Array
from analysis.traces.align import robot_alone
from analysis.traces.csv_tables import table_from
from analysis.traces.tables import CircleTable
from daq.store import Run
from rigs.errors import FileError
from rigs.schema.vocabulary import Direction


@dataclass(frozen=True)
class RobotMotion:
    """Reported angles q (n, 6) rad at times t_s (n,) s; where: its name in messages; direction: that of its label, if
    it has one; doubts in words."""

    where: str
    t_s: Array
    q: Array
    direction: Direction | None = None
    doubts: tuple[str, ...] = ()


def motion_in(run: Run) -> RobotMotion:
    """The motion of a run, recorded, imported or simulated. Raises FileError where it holds none."""
    path, direction = run.path, run.manifest.direction
    if run.table is None:
        t_s, q, doubts = robot_alone(path, run)
        return RobotMotion(str(path), t_s, q, direction, doubts)
    table = table_from(run.table, run.manifest.test, direction, str(path))
    if not isinstance(table, CircleTable):
        problem = f"is a {run.manifest.test} table: it has single readings and no motion"
        raise FileError(str(path), problem, "give a run of the circle, or a recorded run")
    return RobotMotion(str(path), table.t_s, table.q, direction)
