"""As a service: what systemd is told, the unit itself, and a command line that starts without its heavy parts."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from bench import PATIENCE_S, Bench

UNIT = Path(__file__).parents[2] / "systemd" / "rigd@.service"


def test_systemd_hears_ready_watchdog_and_stopping(bench: Bench) -> None:
    address = bench.folder / "notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(address))
        manager.settimeout(PATIENCE_S)
        bench.env |= {"NOTIFY_SOCKET": str(address), "WATCHDOG_USEC": "2000000"}
        bench.start()
        assert manager.recv(4096).startswith(b"READY=1\nSTATUS=reading g1 on ")
        assert manager.recv(4096) == b"WATCHDOG=1"
        assert manager.recv(4096) == b"WATCHDOG=1"
        assert bench.signalled(signal.SIGTERM)[0] == 0
        heard = b""
        while heard != b"STOPPING=1":
            heard = manager.recv(4096)


def test_the_watchdog_is_fed_while_a_gauge_is_gone(bench: Bench) -> None:
    """A lost instrument is no reason to restart a daemon that is trying to get it back."""
    address = bench.folder / "notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(address))
        manager.settimeout(PATIENCE_S)
        bench.env |= {"NOTIFY_SOCKET": str(address), "WATCHDOG_USEC": "2000000"}
        bench.start().all_reading()
        bench.cell.stop()
        bench.until(lambda state: not state["streams"]["robot"]["connected"])
        while manager.recv(4096) != b"WATCHDOG=1":
            pass
        assert manager.recv(4096) == b"WATCHDOG=1"


@pytest.mark.skipif(not shutil.which("systemd-analyze"), reason="systemd-analyze is not installed (package systemd)")
def test_the_unit_is_valid_and_hardened(tmp_path: Path) -> None:
    unit = tmp_path / "rigd@cell.service"
    unit.write_text(UNIT.read_text().replace("/opt/rig/bin/rigd", sys.executable))
    done = subprocess.run(["systemd-analyze", "verify", unit], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and not done.stderr, done.stderr
    command = ["systemd-analyze", "security", "--offline=true", "--no-pager", unit]
    rated = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    exposure = float(rated.rsplit("exposure level for", 1)[1].split(":")[1].split()[0])
    assert exposure <= 1.6


@pytest.mark.parametrize("command", [["--help"], ["analyse", "--help"], ["record", "start", "--help"]])
def test_help_loads_nothing_heavy(command: list[str]) -> None:
    program = (
        "import sys; sys.argv = ['rig', *sys.argv[1:]]\n"
        "from analysis.cli import main\n"
        "try: main()\n"
        "except SystemExit as end: assert not end.code\n"
        "heavy = {'numpy', 'scipy', 'matplotlib', 'pyarrow', 'yaml', 'jinja2'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, *command], capture_output=True, text=True, check=False, env=dict(os.environ)
    )
    assert done.returncode == 0, done.stderr
    assert "Usage: rig" in done.stdout
