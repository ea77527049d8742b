"""Check of a complete cell: computer, daemon if running, and each instrument."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from daq.acquisition.streams import Stream, streams_of
from daq.discovery.cell_finding import CellFinding, FindingVerdict, check_condition, doubtful, ok, wrong
from daq.discovery.examine_computer import examine_computer, examine_port
from daq.discovery.trial import examine_conversation
from daq.service.client import Client, find_socket
from rigs.errors import CellError
from rigs.rig import Rig
from rigs.schema.condition import CONDITION

_FRESH_S = 3.0


def examine(
    rig: Rig, runs: Path, unit: str | None = None, root: Path = Path("/"), *, example: bool = False
) -> Iterator[CellFinding]:
    """Findings one by one.

    unit: service of the rig. root: parent of /dev, /proc and /sys. example: the rig file is a shipped example, whose
    ports may belong to other machines in this network, so they are not opened.
    """
    yield from examine_computer(runs, unit)
    try:
        status = ask_daemon(rig.name)
    except CellError as error:
        yield wrong("rigd", f"{error.where}: {error.what}", error.remedy)
        return
    if status is not None:
        yield from check_daemon(status, streams_of(rig))
    if example and status is None:
        why = "its ports and addresses do not belong to your cell and were not tried"
        remedy = "create the rig file of your cell with rig init cell.yaml, and give that file"
        yield doubtful("instruments", f"this rig file is a shipped example; {why}", remedy)
        return
    for stream in streams_of(rig):
        findings = []
        if stream.port.startswith("/"):
            findings = list(examine_port(stream.name, stream.port, root, served=status is not None))
        yield from findings
        if status is None and all(finding.verdict is not FindingVerdict.WRONG for finding in findings):
            gauge = rig.gauges.recorded.get(stream.columns[0].removesuffix("_mm"))
            yield from examine_conversation(stream, (gauge.timeout_s if gauge else rig.feedback.timeout_s))


def ask_daemon(rig: str) -> dict[str, Any] | None:
    """Status of the daemon of this rig; None if it is not running."""
    try:
        path = find_socket(rig)
    except CellError:
        closed = [folder for folder in Path("/run").glob("rigd-*") if not os.access(folder, os.X_OK)]
        if closed:
            problem, remedy = "this user has no permission to query the daemon", "join the group rig, or use sudo"
            raise CellError(str(closed[0]), problem, remedy, code="daemon.refused") from None
        return None
    with Client(path) as client:
        return client.ask("status")


def check_daemon(status: dict[str, Any], streams: Sequence[Stream]) -> Iterator[CellFinding]:
    """Findings from the status of a daemon that has opened the ports. streams: streams of the rig file."""
    recording = f"records {status['recording']}" if status["recording"] else "records nothing"
    yield ok("rigd", f"serves {status['rig']} and {recording}; queried through the daemon")
    served = {name: stream.get("port") for name, stream in status["streams"].items()}
    if None in served.values():
        yield doubtful("rigd", "is an older version than this rig", "restart rigd between two recordings")
    elif served != {stream.name: stream.port for stream in streams}:
        ports = ", ".join(f"{name} on {port}" for name, port in served.items())
        remedy = "restart rigd, or give the matching rig file"
        yield wrong("rigd", f"reads {ports}: different from the rig file", remedy)
    for name, stream in status["streams"].items():
        yield _check_stream(name, stream)
        if stream["connected"]:
            now = {column: stream["last"][column] for column, age_s in stream["age_s"].items() if age_s <= _FRESH_S}
            yield from check_condition(name, now)


def _check_stream(name: str, stream: dict[str, Any]) -> CellFinding:
    if not stream["connected"]:
        return wrong(name, "the port is not open", stream["last_fault"] or "see rig logs")
    ages_s = {column: age_s for column, age_s in stream["age_s"].items() if column not in CONDITION}
    silent = [column for column, age_s in ages_s.items() if age_s > _FRESH_S]
    if silent or not ages_s:
        observation = f"readings of {', '.join(silent) or name} are missing"
        return wrong(name, observation, stream["last_fault"] or "see rig logs")
    faults = {kind: count for kind, count in stream["counters"].items() if kind != "samples"}
    good = stream["counters"].get("samples", 0)
    observation = f"{stream['rate_hz']:.1f} readings a second, {good} so far"
    if sum(faults.values()) * 100 > good:
        counts = ", ".join(f"{count} {kind}" for kind, count in faults.items())
        return doubtful(name, f"{observation}; {counts}", stream["last_fault"])
    return ok(name, observation)
