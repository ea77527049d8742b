"""`rig doctor RIG`: problems of a cell. `rig logs [RIG]`: log entries of the service."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from analysis.cli import completion
from analysis.cli.commands import app, command
from analysis.cli.completion import SERVED
from analysis.cli.console import say, say_json
from analysis.cli.options import AsJson, RigArgument
from rigs.text import escape_text

if TYPE_CHECKING:
    from daq.service.journal import JournalEntry


_COLOURS = {"ok": "green", "doubtful": "yellow", "wrong": "red"}


@command(app, "rig doctor cell.yaml")
def doctor(
    rig_file: RigArgument,
    runs: Annotated[Path | None, typer.Option(help="Directory of the runs; default: the directory of rigd.")] = None,
    scan: Annotated[
        bool,
        typer.Option("--scan", help="Find unit, registers and byte orders of Modbus gauges while you move a probe."),
    ] = False,
    bundle: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.zip",
            help="Pack rig file, one short run, these findings and versions for an issue, without names of people, "
            "computers and directories; default: pack nothing.",
        ),
    ] = None,
    run: Annotated[
        Path | None,
        typer.Option(
            metavar="RUN", autocompletion=completion.runs, help="Run in the bundle; default: the newest short one."
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Report what is wrong with a cell: ports, line settings, rates, clocks, disk, service.

    Connects to the instruments in the same way as rigd, and tries other line
    settings if an instrument does not answer. If rigd is running, its state is
    reported instead. With --scan, other addresses and formats of Modbus gauges
    are tried until a value changes like a moved probe. The exit code is 1 if
    something is wrong.
    """
    import dataclasses
    from functools import partial

    from daq.discovery.cell_finding import FindingVerdict
    from daq.discovery.examine import examine
    from daq.discovery.modbus_scan import scan_modbus
    from rigs.errors import UseError
    from rigs.load import find, is_shipped, load

    if run and not bundle:
        raise UseError("--run", "is the run in a bundle", "give --bundle FILE.zip also")
    if bundle and scan:
        raise UseError("--bundle", "needs the findings without --scan", "leave one of the options out")
    rig, _ = load(rig_file)
    path = find(rig_file).absolute()
    if scan and is_shipped(path):
        problem = f"queries the ports of the rig file, and {rig_file} is a shipped example"
        raise UseError("--scan", problem, "give the rig file of your cell")
    findings, where = [], runs or Path("runs")
    if scan:
        made = scan_modbus(rig, partial(say, err=True))
    else:
        unit = f"rigd@{path.stem}" if path.parent == SERVED else None
        where = runs or Path(f"/var/lib/{unit.replace('@', '-')}/runs" if unit else "runs")  # the service has its own
        made = examine(rig, where.absolute(), unit, example=is_shipped(path))
    for finding in made:
        findings.append(finding)
        if not as_json:
            verdict = typer.style(f"{finding.verdict:9}", fg=_COLOURS[finding.verdict])
            remedy = f"; {finding.remedy}" if finding.remedy else ""
            say(f" {finding.about}: {finding.what}{remedy}", mark=verdict)
    wrong = sum(finding.verdict is FindingVerdict.WRONG for finding in findings)
    rows = [dataclasses.asdict(finding) for finding in findings]
    packed = _bundle(bundle, rig_file, run, where, rows, quiet=as_json) if bundle else {}
    if as_json:
        say_json({"rig": rig.name, "wrong": wrong, "findings": rows, **packed})
    raise typer.Exit(1 if wrong else 0)


def _bundle(
    file: Path, rig_file: str, run: Path | None, runs: Path, findings: list[dict[str, Any]], *, quiet: bool
) -> dict[str, Any]:
    """Write a bundle, say what it contains, and return the same for JSON."""
    from analysis.apps.commission.support_bundle import make_bundle
    from analysis.runs.written_files import write_new

    made = make_bundle(rig_file, run, runs.absolute(), findings)
    write_new(file, made.write)
    if not quiet:
        for line in made.lines():
            say(line)
        say(f"wrote {file}; look at its files before you attach it to an issue")
    stated = {key: list(getattr(made, key)) for key in ("packed", "replaced", "left_out")}
    return {"bundle": {"file": str(file), **stated}}


@command(app, "rig logs cell --since today")
def logs(
    rig: Annotated[
        str | None,
        typer.Argument(
            metavar="RIG",
            autocompletion=completion.services,
            help="NAME of rigd@NAME, or the rig file; default: all services.",
        ),
    ] = None,
    since: Annotated[
        str | None, typer.Option(help="Time of the first entry: today, -1h, '2026-11-20 08:00'; default: the oldest.")
    ] = None,
    follow: Annotated[
        bool, typer.Option("--follow", "-f", help="Show new entries until Ctrl-C; default: end after the last entry.")
    ] = False,
) -> None:
    """Show what the services rigd@NAME have logged, and when systemd started and stopped them."""
    import contextlib
    from pathlib import Path

    from daq.service.journal import read_journal

    name = rig and Path(rig).name.removesuffix(".yaml")
    with contextlib.suppress(KeyboardInterrupt):
        for entry in read_journal(name, since, follow=follow):
            typer.echo(line(entry, named=rig is None))


def line(entry: JournalEntry, *, named: bool) -> str:
    """Log entry with time, severity if relevant, and text; `named` with the rig."""
    from daq.service.journal import ERROR, INFO, WARNING

    word, colour = "", None
    if entry.severity <= WARNING:
        word, colour = ("error", "red") if entry.severity <= ERROR else ("warning", "yellow")
    who = f"{escape_text(entry.rig):10} " if named else ""
    text = escape_text(f"systemd: {entry.text}" if entry.by_systemd else entry.text)
    styled = typer.style(f"{word:8}{text}", fg=colour, dim=entry.severity >= INFO and entry.by_systemd)
    return f"{entry.at:%Y-%m-%d %H:%M:%S} {who}{styled}"
