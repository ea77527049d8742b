"""Independently generated cells, sound or with one broken convention, and the expected findings of rig.

Circles and targets come from `tests.worlds.stranger`. Poses come from an arm computed by py-opw-kinematics or by plain
matrix products. Each arm has every effect at its healthy size.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from analysis.procedures.shared.finding import Finding
from analysis.runs.loading import Measured, measured_of
from analysis.runs.table_format import columns_of
from analysis.runs.tables import CircleTable, PoseTable, RadialTable, RepeatabilityTable, Table
from daq.store import table_run
from rigs.load import load, parse
from rigs.rig import Rig
from tests.support import driven_on
from tests.support.five_arms import ARMS, OPW, PeerArm
from tests.worlds.arms import independent_arm
from tests.worlds.stranger.faults import Fault
from tests.worlds.stranger.gauges import Link
from tests.worlds.stranger.joints import Trace
from tests.worlds.stranger.measure import measure, trace_of
from tests.worlds.stranger.motion import Motion, approaches, visits
from tests.worlds.stranger.real.arm import healthy_arm
from tests.worlds.stranger.real.programs import circle
from tests.worlds.stranger.sight import Sight, sight_of

Array = NDArray[np.float64]
ROBOTS = ("paper-fanuc", "ur10e")
_REPEATS_RAD = np.radians(0.001)
"""Standard deviation of each joint angle between runs."""
_WHITE_MM = 0.001


def rig_of(name: str) -> Rig:
    """Model of a rig file for one of the five arms."""
    rig, arm = load("paper-fanuc")[0], ARMS[name]
    axes = tuple(
        axis.model_copy(
            update={
                "a_mm": float(arm.a[k]),
                "d_mm": float(arm.d[k]),
                "alpha_deg": float(np.degrees(arm.alpha[k])),
                "beta_deg": 0.0,
                "offset_deg": float(np.degrees(arm.offset[k])),
            }
        )
        for k, axis in enumerate(rig.robot.axes)
    )
    coupling = tuple(tuple(float(x) for x in row) for row in arm.coupling)
    robot = rig.robot.model_copy(update={"axes": axes, "coupling": coupling})
    return rig.model_copy(update={"robot": robot})


def run_of(table: Table, name: str, rig: Rig) -> Measured:
    direction = table.direction if isinstance(table, CircleTable) else None
    kind = {RadialTable: "radial", RepeatabilityTable: "repeatability", PoseTable: "pose"}
    test = table.test if isinstance(table, CircleTable) else kind[type(table)]
    run = table_run(
        Path(name), columns_of(table), test=test, direction=direction, rig_name=rig.name,  # type: ignore[arg-type]
        rig_text=load("paper-fanuc")[1], operator="", source="t.csv", source_sha256="0" * 64,
    )  # fmt: skip
    return measured_of(run, rig)


def poses(name: str, rng: np.random.Generator, count: int = 60) -> Measured:
    """Simulate poses of an imperfect arm measured by a tracker at a random place."""
    q = rng.uniform(-1, 1, (count, 6)) * np.radians([120, 45, 45, 120, 80, 150])
    q[:, 2] += 0.4
    q[:, 1] -= 0.5 * (name == "ur10e")
    if name in OPW:
        wave = np.radians(0.02) * np.sin(q + rng.uniform(0, 6, 6)) + np.radians(rng.normal(0, 0.02, 6))
        T = PeerArm(OPW[name]).forward(q + wave)
        R, p = T[:, :3, :3], T[:, :3, 3]
    else:
        R, p = independent_arm.flange(independent_arm.constants_of(name), independent_arm.healthy(rng), q)
    tool, turn = rng.uniform([-80, -80, 60], [80, 80, 300]), Rotation.from_rotvec(rng.uniform(-2, 2, 3))
    xyz = turn.apply(p + R @ tool) + rng.uniform(-3000, 3000, 3) + rng.normal(0, 0.03, p.shape)
    return run_of(PoseTable(q, xyz, None), "poses", rig_of(name))


@cache
def scene(robot: str) -> tuple[Sight, Rig, list[Motion], list[Trace]]:
    """A cell: its instrument, its rig, and the motions and traces of yaw and roll laps in both directions and
    of a radial and a repeatability program.
    """
    sight = sight_of(robot)
    cell = sight.cell
    laps = [circle(cell, sight.track, test, sense, 1) for test in ("yaw", "roll") for sense in (1, -1)]
    order = np.arange(len(sight.targets["q"]))
    stops = visits(cell, sight.targets, order, np.full(len(order), 2.5))
    near = approaches(cell, sight.targets, [1, 2, 5, 9], 15.0, 4)
    motions = [*(replace(one, rows=one.rows[::10]) for one in laps), stops, near]
    rig = parse(yaml.safe_dump(cell.data, allow_unicode=True), robot)
    return sight, rig, motions, [trace_of(cell, one) for one in motions]


def gauged(robot: str, rng: np.random.Generator, faults: Sequence[Fault], tests: Sequence[int]) -> list[Measured]:
    """Simulate runs of a cell with gauges, for an arm with these faults and all other effects at healthy size.

    tests: indices of motions in the scene.
    """
    sight, rig, motions, traces = scene(robot)
    way = rng.standard_normal(3)
    off = rng.uniform(0.3, 1.0) * way / np.linalg.norm(way)
    every = [*faults, *(fault for fault in healthy_arm(1.0, rng) if fault.effect != "vibration")]
    runs = []
    for k in tests:
        motion = motions[k]
        zeros = rng.uniform(-0.3, 0.3, 2 if k < 4 else 1)
        link = Link(motion.place.centre + off, zeros, sight.cell.gauge_at)
        g_mm = measure(sight.cell, motion, every, link, rng.normal(0, _REPEATS_RAD, 6), trace=traces[k])
        g_mm = g_mm + rng.normal(0, _WHITE_MM, g_mm.shape)
        t_s, q = motion.t[motion.rows], motion.q[motion.rows]
        runs.append(run_of(_table(k, motion, t_s, q, g_mm), f"run-{k}", rig))
    return runs


def _table(k: int, motion: Motion, t_s: Array, q: Array, g_mm: Array) -> Table:
    if k < 4:
        return CircleTable("yaw" if k < 2 else "roll", "acw" if k % 2 == 0 else "cw", t_s, q, g_mm)
    labels = {name: np.asarray(values) for name, values in motion.labels.items()}
    if k == 4:
        whole = {name: labels[name].astype(np.int64) for name in ("target", "orientation")}
        return RadialTable(
            whole["target"], labels["polar"], labels["azimuth"], whole["orientation"], t_s, q, g_mm[:, 0]
        )
    target, turn = (labels[name].astype(np.int64) for name in ("target", "round"))
    return RepeatabilityTable(target, labels["approach"].astype(str), turn, t_s, q, g_mm[:, 0])


def play(rng: np.random.Generator) -> Fault:
    """A backlash of a random joint, 0.01 to 0.05 degrees."""
    return Fault("backlash", {"axis": int(rng.integers(1, 7))}, float(rng.uniform(0.01, 0.05)))


def sound(number: int, seed: int = 0) -> list[Measured]:
    """Simulate a sound cell. Of every three cells, two have gauges and one has a tracker."""
    rng = np.random.default_rng([seed, number, 1])
    if number % 3 == 2:
        return [poses(list(ARMS)[number // 3 % len(ARMS)], rng)]
    faults = [play(rng)] if number % 2 else []
    return gauged(ROBOTS[number % 2], rng, faults, range(6))


def driven_on_from(number: int, seed: int = 0) -> list[Measured]:
    """Simulate a sound cell whose robot starts the cw lap where the acw lap ended, so joints differ by full turns
    between the directions.

    Every third cell drives two continuous laps, every second cell starts with joints shifted by full turns, and two of
    three have backlash.
    """
    rng = np.random.default_rng([seed, number, 3])
    name = driven_on.ROBOTS[number % 2]
    wrong, ball = independent_arm.healthy(rng), rng.normal(0, 0.4, 3)
    play_rad = np.zeros(6)
    if number % 3:
        play_rad[rng.integers(6)] = np.radians(rng.uniform(0.01, 0.05))
    runs = []
    for test in ("yaw", "roll"):
        for sense, way in ((1, "acw"), (-1, "cw")):
            turns = (0, 0, 0, *rng.integers(-1, 2, 3).tolist()) if number % 2 else (0,) * 6
            drive = driven_on.Drive(test, sense, 1 + (number % 3 == 0), turns)
            got = driven_on.drive(name, drive, wrong, rng, play_rad=play_rad, ball_mm=ball)
            table = CircleTable(test, way, got.t_s, got.q, got.g_mm)  # type: ignore[arg-type]
            runs.append(run_of(table, f"{test}-{way}", load(name)[0]))
    return runs


@dataclass(frozen=True)
class Broken:
    """Runs with a broken convention, the name of that convention, and words of which the finding must contain one."""

    runs: list[Measured]
    convention: str
    meant: tuple[str, ...]


def _with(run: Measured, **fields: object) -> Measured:
    return run_of(replace(run.table, **fields), run.run.manifest.name, run.rig)  # type: ignore[arg-type]


def _joints(rng: np.random.Generator, number: int) -> Measured:
    """Return poses of one of the five arms, or a run with gauges."""
    if number % 2 == 0:
        return poses(list(ARMS)[number // 2 % len(ARMS)], rng)
    return gauged(ROBOTS[number // 2 % 2], rng, [], [(0, 2, 4)[number // 4 % 3]])[0]


def coupling(rng: np.random.Generator, number: int) -> Broken:
    """Report joint 3 relative to the horizontal."""
    run, sign = _joints(rng, number), float(rng.choice([-1, 1]))
    q = run.table.q.copy()
    q[:, 2] -= sign * q[:, 1]
    return Broken([_with(run, q=q)], "joints", ("J3 + J2" if sign > 0 else "J3 - J2",))


def reversed_axis(rng: np.random.Generator, number: int) -> Broken:
    """Reverse the sign of one axis."""
    run, axis = _joints(rng, number), int(rng.integers(6))
    q = run.table.q.copy()
    q[:, axis] *= -1
    return Broken([_with(run, q=q)], "joints", (f"J{axis + 1} counted in the opposite direction",))


def several_reversed(rng: np.random.Generator, number: int) -> Broken:
    """Reverse the signs of two to five axes."""
    run, axes = _joints(rng, number), np.sort(rng.choice(6, int(rng.integers(2, 6)), replace=False))
    q = run.table.q.copy()
    q[:, axes] *= -1
    *first, last = [f"J{axis + 1}" for axis in axes]
    return Broken([_with(run, q=q)], "joints", (f"{', '.join(first)} and {last} counted in the opposite direction",))


def exchanged_columns(rng: np.random.Generator, number: int) -> Broken:
    """Exchange two joint columns."""
    run = _joints(rng, number)
    one, other = sorted(rng.choice(6, 2, replace=False).tolist())
    q = run.table.q.copy()
    q[:, [one, other]] = q[:, [other, one]]
    return Broken([_with(run, q=q)], "joints", (f"J{one + 1} and J{other + 1} exchanged",))


def zero_off(rng: np.random.Generator, number: int) -> Broken:
    """Shift one joint zero by a quarter or half turn."""
    run, axis, off = _joints(rng, number), int(rng.integers(6)), int(rng.choice([90, -90, 180]))
    q = run.table.q.copy()
    q[:, axis] -= np.radians(off)
    return Broken([_with(run, q=q)], "joints", (f"{off:+d}° on J{axis + 1}",))


def gauges_negated(rng: np.random.Generator, number: int) -> Broken:
    """Negate both gauges, on an arm with backlash."""
    runs = gauged(ROBOTS[number % 2], rng, [play(rng)], range(4))
    return Broken([_with(run, g_mm=-run.table.g_mm) for run in runs], "gauge sign", ("both",))  # type: ignore[union-attr]


def one_negated(rng: np.random.Generator, number: int) -> Broken:
    """Negate one gauge."""
    runs, k = gauged(ROBOTS[number % 2], rng, [play(rng)] * (number % 4 < 2), range(2)), int(rng.integers(2))
    signs = np.where(np.arange(2) == k, -1.0, 1.0)
    return Broken([_with(run, g_mm=signs * run.table.g_mm) for run in runs], "gauge sign", (f"g{k + 1} ",))  # type: ignore[union-attr]


def gauges_exchanged(rng: np.random.Generator, number: int) -> Broken:
    """Exchange the columns of g1 and g2."""
    runs = gauged(ROBOTS[number % 2], rng, [play(rng)] * (number % 4 < 2), range(2))
    return Broken([_with(run, g_mm=run.table.g_mm[:, ::-1]) for run in runs], "gauge order", ("exchanged",))  # type: ignore[union-attr]


def unit(rng: np.random.Generator, number: int) -> Broken:
    """Write a column in radians, metres, inches or micrometres."""
    if number % 4 == 0:
        run = poses(list(ARMS)[number // 4 % len(ARMS)], rng)
        return Broken([_with(run, xyz_mm=run.table.xyz_mm / 1e3)], "units", ("",))  # type: ignore[union-attr]
    if number % 4 == 1:
        run = _joints(rng, number // 4)
        return Broken([_with(run, q=np.radians(run.table.q))], "units", ("radians",))
    run = gauged(ROBOTS[number // 4 % 2], rng, [], [0])[0]
    g_mm = run.table.g_mm.copy()  # type: ignore[union-attr]
    g_mm[:, 1] *= 1 / 25.4 if number % 4 == 2 else 1e3
    return Broken([_with(run, g_mm=g_mm)], "units", ("",))


def places(rng: np.random.Generator, number: int) -> Broken:
    """Insert rows of a tracker that lost its target or repeated its last position."""
    run = poses(list(ARMS)[number // 2 % len(ARMS)], rng)
    xyz, row = run.table.xyz_mm.copy(), int(rng.integers(5, 50))  # type: ignore[union-attr]
    xyz[row] = 0.0 if number % 2 else xyz[row - 1]
    return Broken([_with(run, xyz_mm=xyz)], "wildness" if number % 2 else "duplicates", ("",))


def stands(rng: np.random.Generator, number: int) -> Broken:
    """Write three readings of each standstill."""
    run = poses(list(ARMS)[number % len(ARMS)], rng, 20)
    q, xyz = (np.repeat(values, 3, axis=0) for values in (run.table.q, run.table.xyz_mm))  # type: ignore[union-attr]
    return Broken([_with(run, q=q, xyz_mm=xyz + rng.normal(0, 0.005, xyz.shape))], "stands", ("",))


BREAKS: dict[str, Callable[[np.random.Generator, int], Broken]] = {
    "J2 missing in J3": coupling,
    "an axis reversed": reversed_axis,
    "two joint columns exchanged": exchanged_columns,
    "a zero 90° or 180° off": zero_off,
    "both gauges negated, with a play": gauges_negated,
    "one gauge negated": one_negated,
    "gauges exchanged": gauges_exchanged,
    "another unit": unit,
    "a place lost or sent again": places,
    "three readings a stand": stands,
    "several axes reversed": several_reversed,
}
"""Functions that create a cell with a broken convention, by the name of the fault."""


def is_right(finding: Finding, broken: Broken) -> bool:
    return finding.convention == broken.convention and any(words in finding.meant for words in broken.meant)
