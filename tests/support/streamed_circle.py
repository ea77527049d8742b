"""A circle of a worn arm, read by streaming gauges without a clock, with realistic defects.

The defects are a stalled computer, outliers, a temporarily disconnected cable, and a controller clock that shows wrong
times or restarts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml

from analysis.procedures.simulate import simulate
from analysis.robot.kinematics.arm import arm_of, forward, roll_pitch_yaw, without_setup
from analysis.runs.tables import CircleTable
from daq.protocol.conversation import NO_TIME, SampleBlock
from daq.store import RunWriter, new_manifest
from rigs.load import load, load_hidden
from rigs.schema.condition import POSE
from rigs.schema.vocabulary import Direction

GAUGE_HZ, ROBOT_HZ = 1000, 125
WHITE_MM = 0.001
STREAMS = {"g1": ("g1_mm",), "g2": ("g2_mm",), "robot": tuple(f"q{axis}_deg" for axis in range(1, 7))}


@dataclass(frozen=True)
class Trouble:
    """Defects of a run. wild_every: interval of outliers of 0.3 mm in g1, in addition to 40 consecutive ones in the
    middle. pulled: share of the run after which g2 is silent. wrong, restarts: shares at which a timestamp of the
    robot's clock is wrong, and at which the clock restarts. held_up: shares at which the computer stalls for 0.15
    s.
    """

    wild_every: int = 0
    pulled: tuple[float, float] = (2.0, 2.0)
    wrong: tuple[float, ...] = ()
    restarts: tuple[float, ...] = ()
    held_up: tuple[float, ...] = ()


def streamed_circle(
    runs: Path,
    rows: int,
    trouble: Trouble = Trouble(),
    *,
    driven: Direction = "cw",
    label: Direction = "cw",
    with_poses: bool = False,
) -> Path:
    """Write a run directory with `rows` readings of each gauge, in chunks of 4000.

    with_poses: the controller also sends the poses of the flange, computed with the constants of the data sheet.
    """
    streams = STREAMS | ({"robot": (*STREAMS["robot"], *POSE)} if with_poses else {})
    rig, text = load("ur10e")
    table = simulate(load_hidden("ur10e").apply_to(rig), "yaw", driven, 3)
    assert isinstance(table, CircleTable)
    data = yaml.safe_load(text)
    for number, offset_mm in enumerate((25, -25), start=1):
        port = f"/dev/serial/by-id/usb-FTDI_gauge_{number}-if00-port0"
        gauge = {"interface": "micro_epsilon_ild1420", "port": port, "range_mm": 10}
        data["gauges"][f"g{number}"] = gauge | {"offset_mm": offset_mm, "accuracy_mm": 0.002}
    writer = RunWriter.create(
        runs,
        new_manifest(
            name="circle",
            test="yaw",
            direction=label,
            rig_name="ur10e",
            rig_text=yaml.safe_dump(data),
            operator="",
            streams=streams,
        ),
        chunk_rows=4000,
    )
    for stream in STREAMS:
        samples = _samples(stream, table, rows, trouble)
        if with_poses and stream == "robot":
            T = forward(without_setup(arm_of(rig.robot)), np.radians(samples.values))
            poses = [[*frame[:3, 3], *np.degrees(roll_pitch_yaw(frame))] for frame in T]
            samples = replace(samples, values=np.hstack([samples.values, poses]))
        for begin in range(0, len(samples), 4000):
            writer.append(stream, samples.chosen(slice(begin, begin + 4000)))
            writer.write()
    writer.close("complete", "written", {})
    return writer.path


def _samples(stream: str, table: CircleTable, rows: int, trouble: Trouble) -> SampleBlock:
    rng = np.random.default_rng(len(stream) + rows)
    rate = ROBOT_HZ if stream == "robot" else GAUGE_HZ
    number = np.arange(rows * rate // GAUGE_HZ)
    taken_s, whole_s = number / rate + 0.3e-3 * (stream == "g2"), rows / GAUGE_HZ  # no common reading times
    at_s = table.t_s[0] + taken_s * np.ptp(table.t_s) / whole_s
    clock_s = np.full(len(number), np.nan)
    if stream == "robot":
        came_s = taken_s + 200e-6 + rng.exponential(300e-6, len(number))
        values = np.stack([np.degrees(np.interp(at_s, table.t_s, joint)) for joint in table.q.T], axis=1)
        clock_s = 1000 + taken_s * (1 + 30e-6)
        for share in trouble.restarts:
            clock_s[taken_s >= share * whole_s] -= 900 + 10 * share
        clock_s[[int(share * len(number)) for share in trouble.wrong]] += 0.4
    else:
        came_s = taken_s * (1 + 20e-6) + rng.exponential(50e-6, len(number))
        exact_mm = np.interp(at_s, table.t_s, table.g_mm[:, int(stream[1]) - 1])
        values = (exact_mm + rng.normal(0, WHITE_MM, len(number)))[:, None]
        if trouble.wild_every and stream == "g1":
            values[:: trouble.wild_every] += 0.3
            values[rows // 2 : rows // 2 + 40] -= 0.5
    for share in trouble.held_up:
        begin_s = share * whole_s
        came_s = np.where((came_s > begin_s) & (came_s < begin_s + 0.15), begin_s + 0.15, came_s)
    came_ns = (1e9 + 1e9 * np.maximum.accumulate(came_s)).astype(np.int64)
    there = np.ones(len(number), dtype=bool)
    if stream == "g2":
        there = (taken_s < trouble.pulled[0] * whole_s) | (taken_s >= trouble.pulled[1] * whole_s)
    size = np.full(len(number), 63 if stream == "robot" else 3)
    asked = np.full(len(number), NO_TIME, dtype=np.int64)
    return SampleBlock(values, asked, came_ns, came_ns, size, clock_s, np.zeros(len(number), dtype=np.int64)).chosen(
        there
    )
