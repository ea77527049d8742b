"""The trace of a report: who measured what, when, with which instruments and programs, and the hashes of the files."""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from dataclasses import dataclass

from analysis.api import Result
from rigs.rig import Rig
from rigs.schema.probe import Certificate


@dataclass(frozen=True)
class RunTrace:
    """A run: where it lies, when and by whom it was measured, with which program, and its files with their SHA-256."""

    name: str
    title: str
    path: str
    started: str
    operator: str
    host: str
    software: str
    source: str
    rig_sha256: str
    files: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Instrument:
    """A gauge, the ball or the link, with its certificate."""

    name: str
    kind: str
    certificate: str
    calibrated: str
    due: str


def runs_of(results: Sequence[Result]) -> list[RunTrace]:
    """The runs of a report, in its order."""
    return [_run(result) for result in results]


def _run(result: Result) -> RunTrace:
    manifest = result.measured.run.manifest
    return RunTrace(
        name=result.name,
        title=result.title,
        path=str(result.measured.path),
        started=manifest.started,
        operator=manifest.operator,
        host=manifest.host,
        software=", ".join(f"{name} {version}" for name, version in manifest.software.items()),
        source=manifest.table.file if manifest.table else "",
        rig_sha256=manifest.rig_sha256,
        files=tuple((chunk.file, chunk.sha256) for chunk in manifest.chunks),
    )


def instruments_of(rig: Rig) -> list[Instrument]:
    """The gauges of a rig, its ball and its link."""
    parts = [_instrument(name, gauge.interface, gauge.certificate, gauge.calibrated) for name, gauge in rig.gauges]
    others = (("ball", rig.ball), ("link", rig.link))
    return parts + [_instrument(name, "", part, None) for name, part in others if part is not None]


def _instrument(name: str, kind: str, certificate: Certificate | None, calibrated: dt.date | None) -> Instrument:
    if certificate is None:
        return Instrument(name, kind, "", str(calibrated or ""), "")
    return Instrument(name, kind, certificate.number, str(certificate.date), str(certificate.due or ""))
