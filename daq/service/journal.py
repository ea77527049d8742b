"""systemd journal: writes log lines with their severity, and reads entries.

On standard error, the prefix `<4>` marks a warning (sd-daemon(3)). A redirected child inherits $JOURNAL_STREAM, so
device and inode are compared.
"""

from __future__ import annotations

import json
import logging
import os
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from rigs.errors import CellError
from rigs.text import escape_lines, escape_text

ERROR, WARNING, NOTICE, INFO, DEBUG = 3, 4, 5, 6, 7
_OF_LEVEL = ((logging.CRITICAL, 2), (logging.ERROR, ERROR), (logging.WARNING, WARNING), (logging.INFO, INFO))
_NO_UNIT = "No data available"
"""Message of journalctl if a pattern matches no unit."""
_READABLE = "%(asctime)s %(levelname)s %(message)s"


def is_journal(fd: int = 2) -> bool:
    device, _, inode = os.environ.get("JOURNAL_STREAM", "").partition(":")
    try:
        status = os.fstat(fd)
    except OSError:
        return False
    return (device, inode) == (str(status.st_dev), str(status.st_ino))


def with_severity(text: str, severity: int) -> str:
    """Text for standard error. If that is the journal, every line gets this severity."""
    return "\n".join(f"<{severity}>{line}" for line in text.splitlines()) if is_journal() else text


def formatter() -> logging.Formatter:
    return _JournalFormatter() if is_journal() else _PlainFormatter(_READABLE)


class _PlainFormatter(logging.Formatter):
    """A message cannot forge a second line; only a traceback has several lines."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's name
        record.message = escape_text(record.message)
        return super().formatMessage(record)

    def formatException(self, ei: Any) -> str:  # noqa: N802
        return escape_lines(super().formatException(ei))


class _JournalFormatter(_PlainFormatter):
    def format(self, record: logging.LogRecord) -> str:
        severity = next((severity for level, severity in _OF_LEVEL if record.levelno >= level), DEBUG)
        return with_severity(super().format(record), severity)


@dataclass(frozen=True)
class JournalEntry:
    """A journal entry. rig: instance of the unit. by_systemd: systemd wrote it about the service."""

    at: datetime
    rig: str
    severity: int
    by_systemd: bool
    text: str


def read_journal(rig: str | None, since: str | None = None, *, follow: bool = False) -> Iterator[JournalEntry]:
    unit = f"rigd@{rig or '*'}.service"
    if not shutil.which("journalctl"):
        remedy = "a manually started rigd logs to its terminal"
        raise CellError(unit, "the system has no journal", remedy, code="daemon.silent")
    command = ["journalctl", "--output=json", "--quiet", "--no-pager", f"--unit={unit}"]
    command += ([f"--since={since}"] if since else []) + (["--follow", "--lines=50"] if follow else [])
    has_entries = False
    with subprocess.Popen(  # noqa: S603 - a list, no shell
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, errors="replace"
    ) as journal:
        try:
            for line in journal.stdout or ():
                has_entries = True
                yield entry(json.loads(line))
            complaint = journal.communicate()[1].strip()
        finally:
            journal.terminate()
    if complaint and _NO_UNIT not in complaint:
        raise CellError("journal", complaint.splitlines()[0], "see man journalctl", code="daemon.silent")
    if not has_entries:
        problem = "nothing in the journal" + (f" since {since}" if since else "") + " visible to this user"
        remedy = "start the service: systemctl start rigd@NAME; or join the group systemd-journal, or use sudo"
        raise CellError(unit, problem, remedy, code="daemon.silent")


def entry(fields: dict[str, Any]) -> JournalEntry:
    """Decode an entry of `journalctl --output=json`. Text that is not UTF-8 is a list of bytes in this format."""
    text = fields.get("MESSAGE") or ""
    if isinstance(text, list):
        text = bytes(text).decode("utf-8", "replace")
    by_systemd = fields.get("_PID") == "1"
    unit = str(fields.get("UNIT" if by_systemd else "_SYSTEMD_UNIT", ""))
    return JournalEntry(
        datetime.fromtimestamp(int(fields["__REALTIME_TIMESTAMP"]) / 1e6).astimezone(),
        unit.removeprefix("rigd@").removesuffix(".service"),
        int(fields.get("PRIORITY", INFO)),
        by_systemd,
        text,
    )
