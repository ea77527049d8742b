"""Simulated circle runs on disk, and live views that have followed them."""

from __future__ import annotations

from pathlib import Path

from analysis import save_run, simulate
from analysis.apps.live.played_run import PlayedRun, played_run
from analysis.apps.live.view import LiveView
from rigs.schema.vocabulary import Direction


def lap_run(directory: Path, rig: str = "ur10e-cell", direction: Direction = "acw", seed: int | None = None) -> Path:
    """Write a simulated yaw run with the effects of the shipped cell; by default without noise."""
    run = simulate(rig, "yaw", direction, seed=seed, effects=rig)
    return save_run(run, directory / run.path)


def watched(run: PlayedRun, until_s: float = 1e9, view: LiveView | None = None) -> LiveView:
    """A live view that has followed a replayed run up to a time, in steps of a tenth of a second."""
    view = view or run.begun()
    while run.at_s < until_s and not run.ended:
        run, update = run.after(0.1)
        view = view.after(update)
    return view


def watched_lap(path: Path, until_s: float = 1e9) -> LiveView:
    """A live view that has followed a run on disk up to a time."""
    return watched(played_run(path, 1.0), until_s)
