"""`rig live`: the daemon's state on the screen, ten times a second, in a process of its own.

Of its own, since a screen that renders in the daemon would delay its readers by milliseconds.
"""

from __future__ import annotations

import contextlib

from analysis.cli import app
from analysis.cli.record import RigName

_REFRESH_S = 0.1


@app.command()
def live(rig: RigName = None) -> None:
    """Show gauges, angle, joints, rates, faults and recording state until Ctrl-C; once if there is no terminal."""
    import time  # noqa: PLC0415

    from rich.live import Live  # noqa: PLC0415

    from analysis.reporting.daemon_screen import screen  # noqa: PLC0415
    from analysis.reporting.plain_console import PlainConsole  # noqa: PLC0415
    from daq.service.client import Client, find_socket  # noqa: PLC0415

    console = PlainConsole()
    with (
        contextlib.suppress(KeyboardInterrupt),
        Client(find_socket(rig)) as client,
        Live(screen(client.ask("status")), console=console, auto_refresh=False) as display,
    ):
        # Nothing can be drawn over in a pipe: rich prints the last screen when Live ends, and never learns
        # that the reader has gone.
        while console.is_terminal:
            time.sleep(_REFRESH_S)
            display.update(screen(client.ask("status")), refresh=True)
