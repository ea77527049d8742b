"""CSV tables with the columns of measurement.md, in degrees and mm, a file per run."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from tests.worlds.stranger.screws import Array


def write_rows(
    path: Path,
    t_s: Array,
    q: Array,
    g_mm: Array,
    marks: Mapping[str, Array] | str,
    *,
    encoder_deg: float,
    resolution_mm: float,
) -> None:
    """Write the rows of a run: t_s (m,), q (m, 6) rad, g_mm (m, k); marks: labels (m,) of targets, or direction of a
    circle.
    """
    q = np.round(np.degrees(q) / encoder_deg) * encoder_deg
    g = np.round(g_mm / resolution_mm) * resolution_mm
    columns = {"t_s": [f"{t:.5f}" for t in t_s]}
    if isinstance(marks, str):
        columns["direction"] = [marks] * len(t_s)
    else:
        for key, label in marks.items():
            if key in ("polar", "azimuth"):
                columns[f"{key}_deg"] = [f"{x:.1f}" for x in np.degrees(label)]
            else:
                columns[key] = label.tolist()
    columns |= {f"q{k + 1}_deg": [f"{x:.6f}" for x in q[:, k]] for k in range(6)}
    columns |= {f"g{k + 1}_mm": [f"{x:.4f}" for x in g[:, k]] for k in range(g.shape[1])}
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))
