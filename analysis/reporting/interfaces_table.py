"""The interfaces on the screen: one row each, its line under its name, under its source what is in
doubt, the modem lines that supply it, and when a reading is latched."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from rigs.interfaces import Interface

_STYLE = {"confirmed": "green", "weak": "yellow", "unconfirmed": "red"}


def as_table(interfaces: Sequence[Interface]) -> RenderableType:
    """A table, and under it how many are how sure."""
    table = Table(header_style="bold", show_lines=True)
    table.add_column("interface, line", no_wrap=True)
    table.add_column("instruments", ratio=1, overflow="fold")
    table.add_column("standing", no_wrap=True)
    table.add_column("source; what is in doubt; time of a reading", ratio=2, overflow="fold")
    for interface in interfaces:
        origin = interface.origin
        standing = Text(origin.standing, style=_STYLE[origin.standing])
        timing = f"\ntime: {interface.timing} ({interface.timing_source})" if interface.timing else ""
        modem = f"\nmodem lines: {interface.modem}" if interface.modem else ""
        source = Text.assemble(origin.source, ("\n" + origin.doubts if origin.doubts else "", "yellow"), modem, timing)
        name = Text.assemble((interface.name, "bold"), "\n" + interface.line if interface.line else "")
        table.add_row(name, origin.instruments, standing, source)
    counts = Counter[str](interface.origin.standing for interface in interfaces)
    words = ", ".join(f"{counts[standing]} {standing}" for standing in _STYLE)
    return Group(table, Text(f"{len(interfaces)} interfaces: {words}"))
