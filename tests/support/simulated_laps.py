"""Simulated circle runs on the disk, and views that have watched them."""

from __future__ import annotations

from pathlib import Path

from analysis import save_run, simulate
from analysis.apps.live.played_run import PlayedRun, played_run
from analysis.apps.live.view import LiveView
from rigs.schema.vocabulary import Direction


def lap_run(directory: Path, rig: str = "ur10e", direction: Direction = "acw", seed: int | None = None) -> Path:
    """The run directory of a simulated yaw run, with the effects of the shipped cell; without noise by default."""
    run = simulate(rig, "yaw", direction, seed=seed, effects=rig)
    return save_run(run, directory / run.path)


def watched(run: PlayedRun, until_s: float = 1e9, view: LiveView | None = None) -> LiveView:
    """The view of a run that was played in steps of a tenth of a second up to a time."""
    view = view or run.begun()
    while run.at_s < until_s and not run.ended:
        run, update = run.after(0.1)
        view = view.after(update)
    return view


def watched_lap(path: Path, until_s: float = 1e9) -> LiveView:
    """The view of a run on the disk, watched up to a time."""
    return watched(played_run(path, 1.0), until_s)
