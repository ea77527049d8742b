"""Run directories of a robot over weeks, measured by a stranger's robot and gauges: a healthy arm with every effect of
the vocabulary at a part of its healthy size, ball and gauges mounted anew for each run, and one play that grows."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from analysis import read_table, save_run
from tests.support.store_cases import edit_manifest
from tests.worlds.stranger.cell import read_cell
from tests.worlds.stranger.draw import background
from tests.worlds.stranger.faults import Fault, name_of
from tests.worlds.stranger.gauges import Link
from tests.worlds.stranger.measure import measure
from tests.worlds.stranger.motion import lap, track_of
from tests.worlds.stranger.names import everything
from tests.worlds.stranger.noise import added, drawn_noise, stamps
from tests.worlds.stranger.tables import write_table

_BEGAN = datetime(2026, 3, 2, 9, tzinfo=UTC)
_LAPS = 2


def recorded_history(directory: Path, seed: int, runs: int, begin: int, grown_deg: float = 0.024) -> str:
    """Write runs of the UR10e, yaw acw, two days apart; from run `begin` on the play of an axis is `grown_deg` instead
    of 0.010. Gives the name of the play's figure."""
    rng = np.random.default_rng((seed, runs))
    cell = read_cell("ur10e")
    track, noise = track_of(cell, cell.circle), drawn_noise(rng)
    # What smooth scatter a run has: half the table of real cells, whose upper end no play of this size shows in.
    noise = replace(
        noise,
        joints_deg=float(np.exp(rng.uniform(np.log(3e-4), np.log(2e-3)))),
        ball_mm=float(np.exp(rng.uniform(np.log(1e-3), np.log(1e-2)))),
    )
    axis = int(rng.choice([1, 2, 3]))
    names = [name_of(effect, keys) for effect, keys in everything()]
    healthy = background([name for name in names if name != f"backlash {axis}"], dict.fromkeys(names, 1.0), rng)
    rough = float(rng.uniform(0.0, 0.5))
    for k in range(runs):
        play = Fault("backlash", {"axis": axis}, grown_deg if k >= begin else 0.010, {}, rough)
        motion = lap(cell, track, "yaw", 1, stamps(noise, 120.0, rng), laps=_LAPS)
        way = rng.standard_normal(3)
        ball = cell.circle.centre + rng.uniform(0.1, 1.0) * way / np.linalg.norm(way)
        link = Link(ball + noise.ball_mm * rng.standard_normal(3), rng.uniform(-0.3, 0.3, 2), cell.gauge_at)
        scatter = np.radians(noise.joints_deg) * rng.standard_normal(6)
        phases = {"vibration": float(rng.uniform(0, 2 * np.pi))}
        g_mm = measure(cell, motion, [*healthy, play], link, scatter, phases)
        table = directory / f"{k:03d}.csv"
        write_table(table, motion, g_mm + added(noise, motion.t[motion.rows], 2, rng), noise.encoder_deg)
        run = save_run(read_table(table, "ur10e", "yaw", "acw"), directory / f"run-{k:03d}")
        edit_manifest(run, {"started": (_BEGAN + timedelta(days=2 * k)).isoformat()})
        table.unlink()
    return f"play_j{axis}_deg"
