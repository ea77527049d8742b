"""From a recorded run to one table: each gauge reading beside the joint angles at the same instant.

Gauge 1 sets the rows; the other gauge and the robot are interpolated to its instants. A row is left out,
and counted, where either has a gap there: a straight line across missing data is no measurement.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.clocks import Columns, gauge_instants, robot_instants
from analysis.kinematics.arm import Array
from daq.store import Run, read_run
from rigs.errors import FileError
from rigs.links import tcp_address
from rigs.load import parse
from rigs.rig import Rig

_GAP = 4.0
"""A gap is this many times the usual distance between samples, …"""
_SHORT_NS = 25e6
"""… and longer than this: a quarter of a cycle of the quickest vibration an arm shows, some 10 Hz."""


@dataclass(frozen=True)
class Aligned:
    """A run as one table.

    t_s (n,) since its first row; q (n, 6) rad as reported; g_mm (n, k) of g1 and g2; u_lag_s: standard
    uncertainty of the gauges' time against the robot's; left_out: rows dropped for gaps, by the stream
    that had them; faults: what went wrong while recording, by stream and kind.
    """

    path: Path
    run: Run
    rig: Rig
    t_s: Array
    q: Array
    g_mm: Array
    u_lag_s: float
    left_out: dict[str, int]
    faults: dict[str, int]


def load_aligned(path: Path) -> Aligned:
    """Read a run directory and align it. Raises FileError."""
    run = read_run(path)
    rig = parse(run.manifest.rig_text, f"{path}, rig file")
    return align(path, run, rig)


def align(path: Path, run: Run, rig: Rig) -> Aligned:
    """One table of a run. Raises FileError where a stream is missing or has nothing in common with the rest."""
    gauges = {name: _gauge(path, run, rig, name) for name, _ in rig.gauges}
    robot = _stream(path, run, "q1_deg", "the robot")
    robot_ns, robot_u_s = robot_instants(robot)
    rows_ns, reading, gauge_u_s = gauges["g1"]
    keep = np.ones(len(rows_ns), dtype=bool)
    left_out: dict[str, int] = {}

    def at_rows(name: str, ns: Array, values: Array) -> Array:
        spanned = (rows_ns >= ns[0]) & (rows_ns <= ns[-1])
        dense = _bracketed(rows_ns, ns)
        left_out[name] = int((spanned & ~dense).sum())
        keep[:] &= spanned & dense
        return np.interp(rows_ns, ns, values)

    columns = [reading if name == "g1" else at_rows(name, ns, values) for name, (ns, values, _) in gauges.items()]
    joints = [at_rows("robot", robot_ns, np.radians(robot[f"q{axis}_deg"])) for axis in range(1, 7)]
    if keep.sum() < 2:
        raise FileError(str(path), "gauges and robot share no stretch of time", "record both through the whole test")
    faults = {
        f"{stream} {kind}": count
        for stream, counted in run.manifest.counters.items()
        for kind, count in counted.items()
        if kind != "samples" and count
    }
    t_s = (rows_ns - rows_ns[keep][0])[keep] / 1e9
    u_s = float(np.hypot(gauge_u_s, robot_u_s))
    left_out = {name: count for name, count in left_out.items() if count}
    return Aligned(
        path, run, rig, t_s, np.stack(joints, axis=1)[keep], np.stack(columns, axis=1)[keep], u_s, left_out, faults
    )


def _gauge(path: Path, run: Run, rig: Rig, name: str) -> tuple[Array, Array, float]:
    """Instants (n,) ns, readings (n,) mm and the uncertainty of the instants in s, of one gauge."""
    stream = _stream(path, run, f"{name}_mm", f"gauge {name}")
    gauge = dict(rig.gauges)[name]
    instants, u_s = gauge_instants(stream, None if tcp_address(gauge.port) else gauge.line)
    values = stream[f"{name}_mm"]
    there = np.isfinite(values)
    order = np.argsort(instants[there], kind="stable")
    return instants[there][order], values[there][order], u_s


def _stream(path: Path, run: Run, column: str, what: str) -> Columns:
    for stream in run.streams.values():
        if column in stream and np.isfinite(stream[column]).sum() > 1:
            return stream
    raise FileError(str(path), f"holds no readings of {what}", "record again with it connected: rig status tells")


def _bracketed(rows: Array, times: Array) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Which rows (n,) lie between two of `times` (m,) that are no further apart than usual."""
    after = np.clip(np.searchsorted(times, rows, side="left"), 1, len(times) - 1)
    gaps = times[after] - times[after - 1]
    dense: np.ndarray[tuple[int], np.dtype[np.bool_]] = gaps <= max(_SHORT_NS, _GAP * np.median(np.diff(times)))
    return dense
