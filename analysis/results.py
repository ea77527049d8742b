"""From a run directory to its result: the one way that every report, plot and script takes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from analysis.align import Aligned, load_aligned
from analysis.lap import lap_of
from analysis.tables import CircleTable
from analysis.tests.yaw import Yaw, evaluate
from rigs.errors import FileError


@dataclass(frozen=True)
class Result:
    """A run, and what its test found."""

    data: Aligned
    yaw: Yaw

    @property
    def title(self) -> str:
        """`yaw acw`, say."""
        manifest = self.data.run.manifest
        return f"{manifest.test} {manifest.direction}"

    @property
    def doubts(self) -> list[str]:
        """What a person should know before trusting the figures, in words."""
        manifest = self.data.run.manifest
        found = [f"{name}: {count} rows left out for gaps" for name, count in self.data.left_out.items()]
        found += [f"{count} {kind} while recording" for kind, count in self.data.faults.items()]
        if manifest.exit_status != "complete":
            found.append(f"the recording ended {manifest.exit_status}: {manifest.reason}")
        return found


def analyse_run(path: Path) -> Result:
    """Read, align and evaluate a run. Raises FileError."""
    data = load_aligned(path)
    test, direction = data.run.manifest.test, data.run.manifest.direction
    if test != "yaw":
        raise FileError(str(path), f"is a {test} run, which rig analyse does not evaluate yet", "give yaw runs")
    if direction is None:
        raise FileError(str(path), "has no direction, which a circle needs", "record it with --direction cw or acw")
    if data.rig.gauges.g2 is None:
        raise FileError(str(path), "has one gauge, and an angle takes two", "add gauges.g2 to the rig file")
    gauges = data.rig.gauges
    table = CircleTable("yaw", direction, data.t_s, data.q, data.g_mm)
    return Result(
        data, evaluate(lap_of(table, data.rig, str(path)), gauges.baseline_mm, gauges.baseline_u_mm, data.u_lag_s)
    )
