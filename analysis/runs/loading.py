"""Load a run for analysis: table, rig file, and doubts."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterable
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path

import pyarrow as pa

from analysis.robot.kinematics.arm import Array
from analysis.runs.align import align, robot_only
from analysis.runs.controller_poses import (
    are_same_constants,
    controller_doubt,
    controller_poses,
    rig_as_recorded,
)
from analysis.runs.copied_runs import local_run
from analysis.runs.joint_turns import beyond_limits, without_whole_turns
from analysis.runs.noise.certificate import (
    NO_CERTIFICATE,
    Systematic,
    beyond_certificates,
    corrected_gauges,
    link_excess_mm,
    systematic,
)
from analysis.runs.noise.certificate import doubts_of as certificate_doubts
from analysis.runs.robot_condition import NOT_SHOWN, Condition, condition_of
from analysis.runs.stands import average_standstills
from analysis.runs.tables import RAIL, CircleTable, Table, columns_of, format_of, table_from, u_lag_s_of
from analysis.runs.tabular import Tabular
from daq.store import Run, read_run
from rigs.errors import FileError
from rigs.load import calibrated_beside, parse
from rigs.readiness import missing_gauges
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction

ONLY_COMMANDED = (
    "only commanded joint angles are available: angles not reached (deflection under gravity, following "
    "error) cannot be distinguished from errors of zeros, lengths, compliance or gears"
)
"""Doubt about a run with commanded joint angles only."""
SIMULATED = "simulated, "
"""Prefix of the source of a simulated table, followed by the seed."""


@dataclass(frozen=True, repr=False)
class Measured(Tabular):
    """A run: its rig file and the readings as one table, in rad and mm.

    Recorded streams are not kept: the table is derived from them, and those of a long run need much memory.
    """

    path: Path
    """Directory or file of the run."""
    run: Run
    """Manifest and labels."""
    rig: Rig
    """Rig file at the time of the measurement, including its calibration."""
    table: Table
    """Readings of gauges, joints or tracker, aligned to a common time."""
    u_lag_s: float
    """Standard uncertainty of the gauges' time relative to the robot's; 0 for tables with a common time."""
    doubts: tuple[str, ...]
    """Warnings as text."""
    systematic: Systematic = NO_CERTIFICATE
    """Uncertainties from certificates."""
    condition: Condition = NOT_SHOWN
    """Condition of the robot during the run."""

    def __repr__(self) -> str:
        return f"<run {self.run.manifest.name}: {self.table.test} of {self.rig.name}, {len(self.table.q)} rows>"

    @property
    def title(self) -> str:
        """Test and direction, such as `yaw acw`."""
        manifest = self.run.manifest
        return f"{manifest.test} {manifest.direction}" if manifest.direction else manifest.test

    @property
    def is_simulated(self) -> bool:
        """True if the data are simulated: a simulated table, or a run of an emulated cell."""
        table = self.run.manifest.table
        return self.rig.emulated or (table is not None and table.file.startswith(SIMULATED))

    @property
    def has_only_commanded_angles(self) -> bool:
        """True if the joint angles are commands, and measured angles are unknown."""
        table = self.run.manifest.table
        return table is not None and table.only_commanded

    def to_table(self) -> pa.Table:
        """Columns of docs/tables.md: unchanged for an imported table, else those of the aligned table."""
        return columns_of(self.table) if self.run.table is None else self.run.table


def load_measured(path: Path) -> Measured:
    """Load a recorded or imported run by its path, or the table or URL that it stands for. Raises FileError."""
    with local_run(path) as directory:
        run = read_run(directory)
        return measured_of(replace(run, path=path), calibrated_beside(rig_of(run), directory))


def as_recorded(rig: Rig, runs: Iterable[Measured]) -> Rig:
    """Complete a rig that does not state its controller by the controller constants of a run."""
    shown = (run.rig.robot for run in runs if run.rig.robot.controller and run.rig.controller != "unknown")
    if rig.controller != "unknown" or (robot := next(shown, None)) is None:
        return rig
    update = {"axes": robot.axes, "controller": robot.controller, "controller_axes": robot.controller_axes}
    return rig.model_copy(update={"robot": rig.robot.model_copy(update=update)})


def with_controller_of(rig: Rig, runs: Iterable[Measured]) -> list[Measured]:
    """Give all runs the controller constants of a rig, if theirs are the same or were never stated.

    A run whose rig file does not state the controller has the constants of the data sheet.
    """
    robot, made = rig.robot, []
    for run in runs:
        shown = run.rig.robot
        if shown != robot and robot.controller and shown.controller in (robot.controller, None):
            update = {"axes": robot.axes, "controller": robot.controller, "controller_axes": robot.controller_axes}
            is_unstated = shown.controller is None and shown.name == robot.name
            if is_unstated or are_same_constants(shown, robot):
                run = replace(run, rig=run.rig.model_copy(update={"robot": shown.model_copy(update=update)}))  # noqa: PLW2901
        made.append(run)
    return made


def rig_of(run: Run) -> Rig:
    """Parse the rig file in the manifest of a run, without calibration. Raises RigFileError."""
    return parse(run.manifest.rig_text, f"{run.path}, rig file")


def measured_of(run: Run, rig: Rig | None = None) -> Measured:
    """Build the table of a loaded run. rig: in place of the one in the manifest. Raises FileError."""
    path = run.path
    rig = rig or rig_of(run)
    if run.table is None:
        robot = run.streams.get("robot", {})
        doubts, poses = known_doubts(run, rig), controller_poses(robot)
        rig = rig_as_recorded(rig, poses)
        data = align(path, run.streams, run.manifest.test, rig)
        g_mm, beyond = corrected_gauges(rig, [name for name, _ in rig.gauges][: data.g_mm.shape[1]], data.g_mm)
        doubts += [*data.doubts, *beyond_certificates(rig, beyond, len(g_mm))]
        test, direction = run.manifest.test, run.manifest.direction
        table, of_stands = format_of(test).recorded(replace(data, g_mm=g_mm), rig, direction, str(path))
        condition = condition_of(robot) if robot else NOT_SHOWN
        doubts += [*of_stands, *beyond_limits(table, rig), *controller_doubt(rig, poses), *condition.doubts]
        bare = replace(run, streams={})
        return Measured(path, bare, rig, table, data.u_lag_s, tuple(doubts), _systematic(rig, table), condition)
    doubts = [*known_doubts(run, rig), *_taken_as_corrected(run, rig)]
    table = table_from(run.table, run.manifest.test, run.manifest.direction, str(path))
    if RAIL in format_of(table.test).layout(rail=True).known_columns and table.rail != (rig.robot.rail is not None):
        if table.rail:
            problem = f"has {RAIL}, but the arm of the rig file has no rail"
            raise FileError(str(path), problem, "add robot.rail to it", code="rig_file.invalid")
        problem = f"lacks {RAIL}, but the arm of the rig file is on a rail"
        raise FileError(str(path), problem, f"add {RAIL}, the rail position of each row", code="table.invalid")
    table, counted_further = without_whole_turns(average_standstills(table), rig)
    doubts += [*counted_further, *beyond_limits(table, rig)]
    return Measured(path, run, rig, table, u_lag_s_of(run.table), tuple(doubts), _systematic(rig, table))


def known_doubts(run: Run, rig: Rig) -> list[str]:
    """Doubts that do not depend on the readings.

    Raises FileError if the run is invalid, or a replay with instruments out of step.
    """
    seconds = {stream: counted.get("out_of_step", 0) for stream, counted in run.manifest.counters.items()}
    if out_of_step := ", ".join(f"{stream} for {count} s" for stream, count in seconds.items() if count):
        problem = f"was made from a replay out of step ({out_of_step}), so the results would be wrong"
        remedy = "repeat the replay on a less busy computer, and record that replay"
        raise FileError(str(run.path), problem, remedy, code="readings.unsuitable")
    certified, started = format_of(run.manifest.test).certified, run.manifest.started
    for missing in missing_gauges(rig, run.manifest.test):
        remedy = f"{missing.remedy}, then repeat the import"
        raise FileError(
            str(run.path),
            f"is a {run.manifest.test} run, but the rig file {missing.problem}",
            remedy,
            code="rig_file.invalid",
        )
    if not certified:
        return _doubts(run)
    try:
        return [*_doubts(run), *certificate_doubts(rig, certified, dt.date.fromisoformat(started[:10]))]
    except ValueError:
        return [*_doubts(run), f"the start time in the manifest is not a date: {started[:30]!r}"]


def _taken_as_corrected(run: Run, rig: Rig) -> list[str]:
    """Doubts if the rig file corrects readings, and the import does not state whether these are already corrected."""
    table_format, table = format_of(run.manifest.test), run.manifest.table
    names = table_format.gauges
    if not names or table is None or table.file.startswith(SIMULATED):
        return []
    missing = [
        f"the correction of {name} by certificate {gauge.certificate.number}"
        for name, gauge in rig.gauges
        if name in names and gauge.certificate and gauge.certificate.valid_mm
    ]
    if "link" in table_format.certified and link_excess_mm(rig):
        missing.append(f"the difference of {link_excess_mm(rig):+z.4f} mm between link and radius")
    towards = [name for name, gauge in rig.gauges if name in names and gauge.sign < 0]
    turned = (
        f"imported readings are assumed to increase with the distance from the ball: counts of {' and '.join(towards)} "
    )
    turned += "is not applied; otherwise change the sign in the table and repeat the import"
    if not missing:
        return [turned] if towards else []
    fact = f"imported readings are assumed to be corrected: {' and '.join(missing)} is not added"
    return [f"{fact}; for raw readings, correct g1_mm in the table and repeat the import", *[turned] * bool(towards)]


def _systematic(rig: Rig, table: Table) -> Systematic:
    return systematic(rig, table.readings) if format_of(table.test).gauges else NO_CERTIFICATE


def _doubts(run: Run) -> list[str]:
    manifest = run.manifest
    doubts = [
        f"{stream}: {count} {kind} during the recording"
        for stream, counted in manifest.counters.items()
        for kind, count in counted.items()
        if kind != "samples" and count
    ]
    doubts += run.unsealed
    if manifest.exit_status != "complete":
        doubts.append(f"the recording ended {manifest.exit_status}: {manifest.reason}")
    # Original and last value of each changed label, omitting labels that were restored.
    last = {change.field: change for change in manifest.relabelled}
    first = {change.field: change for change in reversed(manifest.relabelled)}
    old_and_new = {name: (first[name].old, last[name].new) for name in last}
    if changes := [
        f"{name} {old or 'none'} to {new or 'none'}" for name, (old, new) in old_and_new.items() if old != new
    ]:
        day = manifest.relabelled[-1].at[:10]
        doubts.append(f"relabelled on {day} after the recording: {', '.join(changes)}")
    if manifest.table:
        doubts += [*manifest.table.assumed, *([ONLY_COMMANDED] if manifest.table.only_commanded else [])]
    if sha256(manifest.rig_text.encode()).hexdigest() != manifest.rig_sha256:
        doubts.append("the rig file in the manifest has been changed since (SHA-256)")
    return doubts


@dataclass(frozen=True)
class RobotMotion:
    """Reported angles q (n, 6) rad at times t_s (n,) s. where: name of the run in messages."""

    where: str
    t_s: Array
    q: Array
    direction: Direction | None = None
    doubts: tuple[str, ...] = ()


def motion_in(run: Run) -> RobotMotion:
    """Motion of a recorded, imported or simulated run. Raises FileError if it contains no motion."""
    path, direction = run.path, run.manifest.direction
    if run.table is None:
        t_s, q, doubts = robot_only(path, run)
        return RobotMotion(str(path), t_s, q, direction, doubts)
    table = table_from(run.table, run.manifest.test, direction, str(path))
    if not isinstance(table, CircleTable):
        problem = f"is a {run.manifest.test} table, which has single readings without motion"
        raise FileError(str(path), problem, "give a circle run, or a recorded run", code="readings.unsuitable")
    return RobotMotion(str(path), table.t_s, table.q, direction)
