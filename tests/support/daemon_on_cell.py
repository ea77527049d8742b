"""The real rigd on an emulated cell, for the scripts that count what it records."""

from __future__ import annotations

import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from daq.apps.emulate.emulated_cell import EmulatedInstruments
from daq.service.client import Client


@contextmanager
def daemon_on(cell: EmulatedInstruments, text: str) -> Iterator[Client]:
    """Starts a cell and rigd on it; gives a client once every stream brings samples. The runs go with it."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        (folder / "rig.yaml").write_text(cell.rig_text(text))
        cell.start()
        command = ["rigd", "rig.yaml", "--runs", "runs", "--socket", "rigd.sock"]
        daemon = subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True)
        assert daemon.stderr is not None
        try:
            next(line for line in daemon.stderr if "serving" in line)
            with Client(folder / "rigd.sock") as client:
                while not all(stream["counters"].get("samples") for stream in client.ask("status")["streams"].values()):
                    time.sleep(0.05)
                yield client
        finally:
            daemon.send_signal(signal.SIGTERM)
            daemon.communicate()
            cell.stop()
