"""`rig interfaces`: what a rig file can name, and how sure we are of each."""

from __future__ import annotations

from analysis.cli.commands import app, command
from analysis.cli.console import say_json
from analysis.cli.options import AsJson


@command(app, "rig interfaces")
def interfaces(
    as_json: AsJson = False,
) -> None:
    """List the gauge and robot interfaces: instruments, line settings, source of the protocol, and what is in doubt."""
    from dataclasses import asdict

    from analysis.reporting.listings import interfaces_table
    from analysis.reporting.plain_console import PlainConsole
    from rigs.interfaces import known

    drivers = known()
    if as_json:
        say_json({"interfaces": [asdict(driver) for driver in drivers]})
    else:
        PlainConsole().print(interfaces_table(drivers))
