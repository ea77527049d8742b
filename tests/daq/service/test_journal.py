import json
import logging
import os
import shutil
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path

import pytest

from analysis.apps.commission.cli_doctor import line
from daq.service import journal
from tests.support.refusals import refused

STAMP = "1795168800000000"
WARNED = {
    "__REALTIME_TIMESTAMP": STAMP,
    "_SYSTEMD_UNIT": "rigd@cell.service",
    "_PID": "106",
    "PRIORITY": "4",
    "MESSAGE": "g1: silent: nothing for 0.5 s",
}
BY_SYSTEMD = {
    "__REALTIME_TIMESTAMP": STAMP,
    "UNIT": "rigd@cell.service",
    "_SYSTEMD_UNIT": "init.scope",
    "_PID": "1",
    "PRIORITY": "3",
    "MESSAGE": "rigd@cell.service: Watchdog timeout (limit 15s)!",
}
"""As a booted systemd 252 wrote them, without the fields that nobody reads here."""


def test_severities_reach_the_journal_and_a_traceback_keeps_its_own(tmp_path, monkeypatch, capfd):
    status = os.fstat(2)
    monkeypatch.setenv("JOURNAL_STREAM", f"{status.st_dev}:{status.st_ino}")
    formatter = journal.formatter()
    try:
        raise TypeError("wrong type")
    except TypeError:
        told = formatter.format(logging.LogRecord("rigd", logging.CRITICAL, "", 0, "died", (), sys.exc_info()))
    assert len(told.splitlines()) > 3 and all(row.startswith("<2>") for row in told.splitlines())
    levels = (logging.DEBUG, logging.INFO, logging.WARNING, logging.ERROR)
    rows = [formatter.format(logging.LogRecord("rigd", level, "", 0, "g1", (), None)) for level in levels]
    assert rows == ["<7>g1", "<6>g1", "<4>g1", "<3>g1"]


def test_redirected_standard_error_names_the_severity(monkeypatch):
    """A child whose standard error was redirected inherits the variable all the same."""
    monkeypatch.setenv("JOURNAL_STREAM", "1:2")
    assert not journal.is_journal()
    record = logging.LogRecord("rigd", logging.WARNING, "", 0, "g1", (), None)
    assert journal.formatter().format(record).endswith(" WARNING g1")
    assert journal.with_severity("error: x", journal.ERROR) == "error: x"


def test_the_daemon_itself_marks_its_lines(tmp_path):
    with (tmp_path / "journal").open("w+") as file:
        status = os.fstat(file.fileno())
        env = {**os.environ, "JOURNAL_STREAM": f"{status.st_dev}:{status.st_ino}"}
        subprocess.run([Path(sys.executable).with_name("rigd"), "no-such-rig"], stderr=file, env=env, check=False)
        file.seek(0)
        assert file.read().startswith("<3>error: no-such-rig: ")


def test_lines_for_a_person():
    warned, watchdog = journal.entry(WARNED), journal.entry(BY_SYSTEMD)
    assert warned.at == datetime.fromtimestamp(1795168800, UTC) and warned.rig == watchdog.rig == "cell"
    clock = f"{warned.at:%Y-%m-%d %H:%M:%S}"
    assert _plain(line(warned, named=False)) == f"{clock} warning g1: silent: nothing for 0.5 s"
    told = _plain(line(watchdog, named=True))
    assert told == f"{clock} cell       error   systemd: rigd@cell.service: Watchdog timeout (limit 15s)!"
    assert line(warned, named=False) != _plain(line(warned, named=False))  # a warning has its colour
    assert journal.entry({**WARNED, "MESSAGE": [103, 49, 255]}).text == "g1\N{REPLACEMENT CHARACTER}"
    assert journal.entry({**WARNED, "MESSAGE": None}).text == ""


def _plain(text: str) -> str:
    import click  # noqa: PLC0415

    return click.unstyle(text)


@pytest.mark.skipif(not shutil.which("journalctl"), reason="no journalctl")
def test_empty_journal_is_one_line():
    with refused("daemon.silent", "nothing in the journal visible to"):
        list(journal.read_journal("no-such-rig"))
    with refused("daemon.silent", "nothing in the journal visible to"):
        list(journal.read_journal(None))
    with refused("daemon.silent", "Failed to parse timestamp"):
        list(journal.read_journal(None, "whenever"))


def test_output_of_journalctl_is_read(tmp_path, monkeypatch):
    """A stand-in prints what a booted system's journal did; the real one is read in scripts/booted."""
    program = tmp_path / "journalctl"
    rows = "\n".join(json.dumps(fields) for fields in (WARNED, BY_SYSTEMD))
    program.write_text(f"#!/bin/sh\necho \"$@\" >{tmp_path}/asked\ncat <<'END'\n{rows}\nEND\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    assert list(journal.read_journal(None, "-1h")) == [journal.entry(WARNED), journal.entry(BY_SYSTEMD)]
    assert (tmp_path / "asked").read_text().endswith("--unit=rigd@*.service --since=-1h\n")
    monkeypatch.setenv("PATH", str(tmp_path / "nowhere"))
    with refused("daemon.silent", "the system has no journal"):
        next(journal.read_journal("cell"))
