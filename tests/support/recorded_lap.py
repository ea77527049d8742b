"""A recorded yaw lap with the defects of real timestamps: late answers, wrong stamps and stalls."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np
import yaml

from analysis.procedures.simulate import simulate
from analysis.runs.tables import CircleTable
from daq.protocol.conversation import NO_TIME, Sample
from daq.store import RunWriter, new_manifest
from rigs.load import load, load_hidden
from rigs.schema.vocabulary import Direction

WRONG = (100, 400)
"""Rows with a wrong timestamp of the robot's clock."""


def recorded(
    runs: Path, stalls: Collection[int] = (), *, label: Direction = "acw", part: float = 1.0, stands_s: float = 0.0
) -> Path:
    """Record a yaw lap by Baumer gauges over TCP that answer within 1 ms, once after 3 ms and once after 20 ms.

    Two timestamps of the robot are wrong. stalls: readings of g1 that are taken 100 ms after the request. The lap is
    driven acw, labelled `label`, and ends after a share `part`; then the robot stands still for `stands_s`.
    """
    rig, text = load("ur10e-cell")
    table = simulate(load_hidden("ur10e-cell").apply_to(rig), "yaw", "acw", 1)
    assert isinstance(table, CircleTable)
    data = yaml.safe_load(text)
    for number, gauge in enumerate(data["gauges"].values()):
        gauge |= {"port": f"tcp://127.0.0.1:{502 + number}", "clock_s": None, "clock_us": None}
    streams = {"g1": ("g1_mm",), "g2": ("g2_mm",), "robot": tuple(f"q{axis}_deg" for axis in range(1, 7))}
    writer = RunWriter.create(
        runs,
        new_manifest(
            name="lap",
            test="yaw",
            direction=label,
            rig_name="ur10e",
            rig_text=yaml.safe_dump(data),
            operator="",
            streams=streams,
        ),
    )
    driven = int(part * len(table.t_s))
    beat_s = float(np.median(np.diff(table.t_s)))
    more_s = table.t_s[driven - 1] + beat_s * np.arange(1, 1 + int(stands_s / beat_s))
    rows = [*range(driven), *([driven - 1] * len(more_s))]
    for k, at in zip(rows, ((5 + np.append(table.t_s[:driven], more_s)) * 1e9).astype(int).tolist(), strict=True):
        took = {300: 20_000_000, 600: 3_000_000}.get(k, 1_000_000)
        for g in (0, 1):
            begin, end = (at - 100_000_000, at) if k in stalls and g == 0 else (at - took // 2, at + took // 2)
            sample = Sample((table.g_mm[k, g],), begin, end, end, 31)
            writer.append(f"g{g + 1}", [sample])
        clock_s = 1000 + at / 1e9 + (0.1 if k in WRONG else 0)
        late = at + 200_000 + 3_000_000 * (k % 7)
        writer.append("robot", [Sample(tuple(np.degrees(table.q[k])), NO_TIME, late, late, 63, clock_s)])
    writer.close("complete", "told to", {})
    return writer.path
