"""A recorded run of a robot at rest at places around a ball, connected by a link with a working or a disconnected
gauge.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from analysis.robot.geometry.driven_programs import radial_program, stops
from analysis.robot.kinematics.arm import Array, arm_of, forward
from daq.protocol.conversation import NO_TIME, Sample
from daq.store import Run, RunWriter, new_manifest, read_run
from rigs.load import load
from rigs.rig import Rig

CENTRE = np.array([-799.0, -201.5, 2.0])
"""True position of the ball, different from the rig file."""
HZ = 50.0


def recorded_stands(runs: Path, *, gauge: bool) -> tuple[Run, Rig]:
    """Record 13 standstills on the hemisphere of the shipped UR10e; return the run and the rig."""
    rig, text = load("ur10e-cell")
    q = radial_program(rig).q[:111:8]
    t_s, path = stops(q, dwell_s=1.2)
    at = np.arange(0.0, t_s[-1], 1 / HZ)
    angles = np.stack([np.interp(at, t_s, joint) for joint in path.T], axis=1)
    angles += np.random.default_rng(4).normal(0, np.radians(0.0003), angles.shape)
    g_mm = np.linalg.norm(forward(arm_of(rig.robot), angles)[:, :3, 3] - CENTRE, axis=1) - 400.0
    return _written(runs, text, at, angles, g_mm if gauge else None), rig


def _written(runs: Path, text: str, t_s: Array, q: Array, g_mm: Array | None) -> Run:
    streams: dict[str, tuple[str, ...]] = {"robot": tuple(f"q{axis}_deg" for axis in range(1, 7))}
    if g_mm is not None:
        streams["g1"] = ("g1_mm",)
    writer = RunWriter.create(
        runs,
        new_manifest(
            name="ball", test="radial", direction=None, rig_name="ur10e", rig_text=text, operator="", streams=streams
        ),
    )
    for k, ns in enumerate(((5 + t_s) * 1e9).astype(int).tolist()):
        writer.append("robot", [Sample(tuple(np.degrees(q[k])), NO_TIME, ns, ns, 63, ns / 1e9)])
        if g_mm is not None:
            writer.append(
                "g1", [Sample((float(g_mm[k]),), ns - 1_000_000, ns + 1_000_000, ns + 1_000_000, 31, ns / 1e9)]
            )
    writer.close("complete", "told to", {})
    return read_run(writer.path)
