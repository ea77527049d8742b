"""What stands at the head and at the end of a report: whom and what it is for, who measured what, when, with which
instruments and programs, and the hashes of the files.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from dataclasses import dataclass

from analysis.api import Result
from analysis.reporting.texts import Texts
from rigs.errors import UseError
from rigs.rig import Rig
from rigs.schema.probe import Certificate

_LONGEST = 200
"""Characters of a field, as the name of an operator may have: a name fits, a page that was pasted does not."""


@dataclass(frozen=True)
class Heading:
    """What a person gives for the head of a report; a field that is empty is left out."""

    serial: str = ""
    customer: str = ""
    order: str = ""

    def check(self) -> None:
        """Raise UseError for a field that does not fit in one line of the page."""
        for name, text in vars(self).items():
            if len(text) > _LONGEST:
                raise UseError(f"--{name}", f"has {len(text)} characters", f"write at most {_LONGEST}")
            if not text.isprintable():
                raise UseError(f"--{name}", "holds control characters", "write it in one line")


NO_HEADING = Heading()


def fields_of(heading: Heading, results: Sequence[Result], texts: Texts) -> list[tuple[str, str]]:
    """Return the fields of the head as name and value: what was given, then what rig file and runs say.

    The serial number is that of the rig files of the runs where none is given, since the model may be of another robot.
    """
    serials = dict.fromkeys(result.measured.rig.robot.serial for result in results)
    operators = dict.fromkeys(result.measured.run.manifest.operator for result in results)
    fields = [
        ("serial", heading.serial or ", ".join(filter(None, serials))),
        ("customer", heading.customer),
        ("order", heading.order),
        ("operator", ", ".join(filter(None, operators))),
    ]
    return [(texts(name), value) for name, value in fields if value]


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
    return [
        RunTrace(
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
        for result in results
        for manifest in [result.measured.run.manifest]
    ]


def instruments_of(rig: Rig) -> list[Instrument]:
    """The gauges of a rig, its ball and its link."""
    parts = [_instrument(name, gauge.interface, gauge.certificate, gauge.calibrated) for name, gauge in rig.gauges]
    others = (("ball", rig.ball), ("link", rig.link))
    return parts + [_instrument(name, "", part, None) for name, part in others if part is not None]


def _instrument(name: str, kind: str, certificate: Certificate | None, calibrated: dt.date | None) -> Instrument:
    if certificate is None:
        return Instrument(name, kind, "", str(calibrated or ""), "")
    return Instrument(name, kind, certificate.number, str(certificate.date), str(certificate.due or ""))
