"""An emulated cell: instruments with readings set by the test, and the real daemon as a separate process."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import yaml

from daq import clock
from daq.emulators.emulated_cell import EmulatedInstruments
from daq.emulators.instruments import MotionSource, emulated
from daq.service.client import Client
from rigs.load import SHIPPED, parse
from tests.support.command_line import ran

PATIENCE_S = 60.0
BIN = Path(sys.executable).parent


class ByHand:
    """Instrument readings set by the test; nan emulates a disconnected gauge head."""

    def __init__(self) -> None:
        self.mm = {"g1": 0.1, "g2": -0.1}
        self.deg = [0.0, 10.0, 20.0, 30.0, 40.0, 50.0]
        self.program = 0

    def gauge_mm(self, name: str, now_ns: int) -> float:
        return self.mm[name]

    def joints_deg(self, now_ns: int) -> list[float]:
        return self.deg

    def signal(self, now_ns: int) -> float:
        return self.program


def rig_text(gauges: str = "sylvac", timeout_s: float = 0.3) -> str:
    """A rig file with short time-outs for a kind of gauge: continuous Sylvac, polled, Keyence, Modbus RTU or
    TCP.
    """
    data = yaml.safe_load((SHIPPED / "ur10e-cell.yaml").read_text())
    if gauges in ("sylvac", "polled"):
        data["gauges"] = yaml.safe_load((SHIPPED / "paper-fanuc.yaml").read_text())["gauges"]
        for name in ("g1", "g2"):
            data["gauges"][name] |= {"mode": "polled" if gauges == "polled" else "continuous", "line": "57600 7E2"}
    elif gauges == "keyence":
        head = {"interface": "keyence_dl_rs1a", "port": "/dev/ttyUSB0", "line": "57600 8N1"}
        data["gauges"] = {
            "g1": {**head, "channel": 1, "offset_mm": 25},
            "g2": {**head, "channel": 2, "offset_mm": -25},
        }
    elif gauges == "tcp":
        for name in ("g1", "g2"):
            data["gauges"][name]["port"] = f"tcp://127.0.0.1:{502 if name == 'g1' else 503}"
    for name in ("g1", "g2"):
        data["gauges"][name]["timeout_s"] = timeout_s
    data["name"] = "bench"
    return yaml.safe_dump(data)


class Watched:
    """Base of benches: polls the status of the daemon until a condition holds."""

    def status(self) -> dict[str, Any]:
        raise NotImplementedError

    def until(self, what: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
        """Poll the status until the condition is true, and return it."""
        deadline = clock.now_s() + PATIENCE_S
        while clock.now_s() < deadline:
            state = self.status()
            if what(state):
                return state
            clock.sleep(0.05)
        raise AssertionError(state)

    def all_reading(self) -> dict[str, Any]:
        return self.until(lambda state: all(s["rate_hz"] > 1 for s in state["streams"].values()))

    def recorded(self, more_than: int) -> dict[str, Any]:
        return self.until(lambda state: min(state["samples"].values()) > more_than)


class Bench(Watched):
    """Emulated cell and daemon in one directory. Leaving the context ends all processes."""

    def __init__(
        self,
        folder: Path,
        text: str | None = None,
        motion: MotionSource | None = None,
        cell: EmulatedInstruments | None = None,
    ) -> None:
        self.folder = folder
        self.motion = ByHand()
        text = text or rig_text()
        self.cell = cell or emulated(
            parse(text, "bench"), motion or self.motion, self.motion.signal, names=folder / "by-id"
        )
        self.rig = folder / "rig.yaml"
        self.rig.write_text(self.cell.rig_text(text))
        self.cell.start()
        self.options: list[str | Path] = []
        self.said: list[str] = []
        self.daemon: subprocess.Popen[str] | None = None
        self.env = {**os.environ, "XDG_RUNTIME_DIR": str(folder)}
        self.socket = folder / "rigd" / "bench.sock"

    def __enter__(self) -> Bench:
        return self

    def __exit__(self, *_: object) -> None:
        if self.daemon is not None and self.daemon.poll() is None:
            self.daemon.kill()
            self.daemon.wait()
        if self.daemon is not None and self.daemon.stderr:
            self.daemon.stderr.close()
        self.cell.stop()

    def start(self, program: Sequence[str | Path] = (BIN / "rigd",), **options: Any) -> Bench:
        """Start the daemon and wait until it accepts requests. `said` contains its output up to then."""
        self.daemon = subprocess.Popen(
            [*program, self.rig, "--runs", "runs", *self.options],
            stderr=subprocess.PIPE,
            env=self.env,
            cwd=self.folder,
            text=True,
            **options,
        )
        assert self.daemon.stderr is not None
        self.said.clear()
        for line in self.daemon.stderr:
            self.said.append(line)
            if "serving" in line:
                return self
        raise AssertionError("".join(self.said))

    def run(self, *command: str | Path) -> subprocess.CompletedProcess[str]:
        """Run a command to completion. `rig` runs in this process, as a client of the daemon."""
        program, *arguments = command
        if program == "rig":
            return ran(*arguments, cwd=self.folder, XDG_RUNTIME_DIR=str(self.folder))
        return subprocess.run(
            [BIN / program, *arguments],
            check=False,
            capture_output=True,
            text=True,
            env=self.env,
            cwd=self.folder,
            timeout=3 * PATIENCE_S,
        )

    @contextlib.contextmanager
    def emulating(
        self, rig: str, *options: str, end: signal.Signals = signal.SIGTERM, code: int = 0
    ) -> Iterator[Callable[[str], str]]:
        """Run `rig emulate` with an emulated keyboard; yield a function that types a line and returns the response.

        At the end the program receives the signal `end` and must exit with `code`.
        """
        process = subprocess.Popen(
            [BIN / "rig", "emulate", rig, *options],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            cwd=self.folder,
            text=True,
        )
        assert process.stdin and process.stdout

        def keyboard(line: str) -> str:
            assert process.stdin and process.stdout
            process.stdin.write(line + "\n")
            process.stdin.flush()
            # The end of an earlier lap may be reported in between.
            return next(said for said in process.stdout if not said.endswith(": done\n")).strip()

        try:
            next(line for line in process.stdout if line.startswith("ready"))
            yield keyboard
        finally:
            process.send_signal(end)
            try:
                said, _ = process.communicate(timeout=PATIENCE_S)
            finally:
                process.kill()
            assert process.returncode == code and " sent" in said

    @contextlib.contextmanager
    def replaying(self, log: Path, rig: Path) -> Iterator[Callable[[], str]]:
        """Run `rig replay`; yield a function that waits for the end and returns the complete output."""
        process = subprocess.Popen(
            [BIN / "rig", "replay", log, rig], stdout=subprocess.PIPE, cwd=self.folder, text=True
        )
        assert process.stdout
        try:
            next(line for line in process.stdout if line.startswith("ready"))
            yield lambda: process.communicate(timeout=3 * PATIENCE_S)[0]
            assert process.returncode == 0
        finally:
            process.kill()
            process.wait()

    def fails(self, *command: str | Path, code: int) -> str:
        """Run a command that must fail with this exit code and a single line of output. Return the line."""
        done = self.run(*command)
        assert done.returncode == code, done.stderr
        assert "Traceback" not in done.stderr
        lines = done.stderr.strip().splitlines()
        assert len(lines) == 1 and lines[0].startswith("error: "), done.stderr
        return lines[0]

    def record(self, name: str = "run", direction: str = "acw") -> Path:
        done = self.run("rig", "record", "start", name, "--test", "yaw", "--direction", direction)
        assert done.returncode == 0, done.stderr
        return Path(done.stdout.strip())

    def status(self) -> dict[str, Any]:
        with Client(self.socket) as client:
            return client.ask("status")

    def signalled(self, number: signal.Signals) -> tuple[int, str]:
        """Send a signal to the daemon and wait for it to exit. Return the exit code and the output."""
        self.daemon.send_signal(number)
        _, said = self.daemon.communicate(timeout=PATIENCE_S)
        return self.daemon.returncode, said


OFF = math.nan
