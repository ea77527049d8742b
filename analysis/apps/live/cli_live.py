"""`rig live`: a separate process, because rendering in the daemon would delay the readers by milliseconds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.cli import completion
from analysis.cli.commands import app, command
from analysis.cli.console import say
from analysis.cli.record import RigName, status


@command(app, "rig live --run runs/lap-acw --speed 4")
def live(
    rig: RigName = None,
    run: Annotated[
        list[Path] | None,
        typer.Option(
            "--run",
            metavar="RUN",
            autocompletion=completion.runs,
            help="Recorded run to play; repeatable; default: none.",
        ),
    ] = None,
    speed: Annotated[
        float | None,
        typer.Option(min=0.125, max=64, help="Speed of --run, as a multiple of real time; default: 1."),
    ] = None,
    plain: Annotated[
        bool, typer.Option("--plain", help="Print a line each second, without a full-screen display.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object each second.")] = False,
) -> None:
    """Show gauges, angle, lap, joints, faults and recording until Ctrl-C.

    The screen fills the terminal. It reconnects when the daemon restarts.
    Without a terminal, the state of the daemon is printed once, unless --plain
    or --json is given. rig window shows curves.
    """
    from analysis.apps.live.loop import is_terminal
    from rigs.errors import UseError

    if plain and as_json:
        raise UseError("--plain and --json", "exclude each other", "give one of them")
    if speed is not None and not run:
        raise UseError("--speed", "is allowed only with --run", "give the run to play")
    in_lines, fills_screen = plain or as_json, is_terminal() and not (plain or as_json)
    if run:
        _play(run, speed or 1.0, as_json=as_json, fills_screen=fills_screen)
    elif not in_lines and not fills_screen:
        status(rig)
    else:
        from analysis.apps.live.daemon_source import DaemonSource
        from analysis.apps.live.loop import print_lines, watch
        from analysis.apps.live.view import LiveView
        from daq.service.client import find_socket

        with DaemonSource(find_socket(rig)) as source:
            if fills_screen:
                watch(source, LiveView())
            else:
                print_lines(source, LiveView(), say, as_json=as_json)


def _play(paths: list[Path], speed: float, *, as_json: bool, fills_screen: bool) -> None:
    from analysis.apps.live.loop import print_lines, watch
    from analysis.apps.live.played_run import RunPlayer, played_run

    runs = [played_run(path, speed) for path in paths]
    player, view = RunPlayer(runs), runs[0].begun()
    if fills_screen:
        watch(player, view, runs[0].zero_mm)
    else:
        print_lines(player, view, say, as_json=as_json)
