"""`rig interfaces`: what a rig file can name, and how sure we are of each."""

from __future__ import annotations

from typing import Annotated

import typer

from analysis.cli import app


@app.command()
def interfaces(
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")] = False,
) -> None:
    """List the gauge and robot interfaces: instruments, line settings, source of the protocol, and what is in doubt."""
    import json  # noqa: PLC0415
    from dataclasses import asdict  # noqa: PLC0415

    from rich.console import Console  # noqa: PLC0415

    from analysis.reporting.interfaces_table import as_table  # noqa: PLC0415
    from rigs.interfaces import known  # noqa: PLC0415

    found = known()
    if as_json:
        typer.echo(json.dumps({"interfaces": [asdict(one) for one in found]}, indent=2, ensure_ascii=False))
    else:
        Console().print(as_table(found))
