"""CSV tables as a stranger writes them: the columns of measurement.md, degrees and mm, a file a run."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from stranger.motion import Motion
from stranger.screws import Array

_RESOLUTION_MM = 1e-4


def write_table(path: Path, motion: Motion, g_mm: Array, encoder_deg: float) -> None:
    """A run: angles at the rows as the encoders step, readings as the display rounds them."""
    rows = motion.rows
    q = np.round(np.degrees(motion.q[rows]) / encoder_deg) * encoder_deg
    columns = {"t_s": [f"{t:.4f}" for t in motion.t[rows]]}
    if motion.labels is None:
        columns["direction"] = ["acw" if motion.sense > 0 else "cw"] * len(rows)
    else:
        columns |= _labels(motion.labels)
    columns |= {f"q{k + 1}_deg": [f"{x:.6f}" for x in q[:, k]] for k in range(6)}
    g = np.round(g_mm / _RESOLUTION_MM) * _RESOLUTION_MM
    columns |= {f"g{k + 1}_mm": [f"{x:.4f}" for x in g[:, k]] for k in range(g.shape[1])}
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))


def _labels(labels: dict[str, Array]) -> dict[str, list[str]]:
    return {
        "target": [f"{k:.0f}" for k in labels["target"]],
        "polar_deg": [f"{x:.1f}" for x in np.degrees(labels["polar"])],
        "azimuth_deg": [f"{x:.1f}" for x in np.degrees(labels["azimuth"])],
        "orientation": [f"{k:.0f}" for k in labels["orientation"]],
    }
