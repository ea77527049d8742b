"""The arm and the gauges of a cell on LinuxCNC, as a process: motors in, readings of two gauges out on ptys.

    python -m tests.worlds.linuxcnc.cell DIRECTORY USER FAULTS.yaml

Gauges of Sylvac type send 8 characters in continuous mode at 4800 baud: a reading is latched, and its last character
arrives after the time of transmission. A client at `DIRECTORY/cell.socket` mounts the ball and the gauges, and asks for
the error of the real tool on the circle. Nothing here is imported from rig.
"""

from __future__ import annotations

import json
import os
import pty
import select
import socket
import subprocess
import sys
import threading
import time
import tty
from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tests.worlds.linuxcnc.arm import Arm, Array, Faults, SetUp, circle_error_um
from tests.worlds.linuxcnc.machine import as_user

_RATE_HZ = 40.0
_CHARACTER_S = 11 / 4800
"""Time of a character with seven bits, parity and two stop bits at 4800 baud."""
_NOISE_MM = 3e-4
_RANGE_MM = 12.0
_KEPT_S = 3.0
_PERIOD_S = 1e-3
_SILENT_S = 5.0


@dataclass
class Motion:
    """The real tool by servo period. The clock of the controller is placed by the earliest arrivals."""

    arm: Arm
    numbers: deque[int] = field(default_factory=deque)
    tools: deque[tuple[Array, Array]] = field(default_factory=deque)
    path: list[Array] = field(default_factory=list)
    recording: bool = False
    offset_s: float = np.inf
    lost: int = 0

    def add(self, rows: Array, now_s: float) -> None:
        """Add samples (n, 8): number, motor angles in degrees and lost samples."""
        numbers = (rows[:, 0] + rows[:, 7]).astype(int)
        if self.numbers and numbers[0] < self.numbers[-1]:  # LinuxCNC was restarted
            self.numbers.clear()
            self.tools.clear()
            self.offset_s = np.inf
        R, p = self.arm.tool(self.arm.links(rows[:, 1:7]))
        self.numbers.extend(numbers.tolist())
        self.tools.extend(zip(R, p, strict=True))
        self.lost = int(rows[-1, 7])
        if self.recording:
            self.path += list(p)
        # The least delay so far; it is forgotten slowly, because clocks drift.
        self.offset_s = min(self.offset_s + 1e-6 * len(rows), now_s - numbers[-1] * _PERIOD_S)
        while len(self.numbers) > _KEPT_S / _PERIOD_S:
            self.numbers.popleft()
            self.tools.popleft()

    def at(self, at_s: float) -> tuple[Array, Array] | None:
        """Tool at a time, None if its sample is not there (yet)."""
        if not self.numbers:
            return None
        place = round((at_s - self.offset_s) / _PERIOD_S) - self.numbers[0]
        return self.tools[place] if 0 <= place < len(self.tools) else None


class Gauges:
    """Two gauges on pseudo-terminals that read the distance to the mounted ball."""

    def __init__(self, directory: Path, motion: Motion, lock: threading.Lock) -> None:
        self.set_up: SetUp | None = None
        self._motion, self._lock, self._noise = motion, lock, np.random.default_rng(7)
        self._ends = []
        for name in ("g1", "g2"):
            end, device = pty.openpty()
            tty.setraw(device)
            os.set_blocking(end, False)
            link = directory / name
            link.unlink(missing_ok=True)
            link.symlink_to(os.ttyname(device))
            self._ends.append((end, device))

    def serve(self) -> None:
        """Send readings at a steady rate, for ever."""
        tick, size = time.monotonic(), 9
        while True:
            tick += 1 / _RATE_HZ
            time.sleep(max(0.0, tick + size * _CHARACTER_S - time.monotonic()))
            with self._lock:
                tool, set_up = self._motion.at(tick), self.set_up
            if tool is None or set_up is None:
                continue
            values = set_up.readings(tool[0][None], tool[1][None])[0] + self._noise.normal(0, _NOISE_MM, 2)
            for (end, _), value in zip(self._ends, np.clip(values, -_RANGE_MM, _RANGE_MM), strict=True):
                with suppress(BlockingIOError):  # commands such as OUT1 need no answer
                    os.read(end, 1000)
                with suppress(BlockingIOError):  # nobody reads
                    os.write(end, f"{value:+08.4f}\r".encode())


def _follow(user: str, motion: Motion, lock: threading.Lock) -> None:
    """Read the motors for ever, also after a restart of LinuxCNC."""
    command = [*as_user(user), "stdbuf", "-oL", "halsampler", "-t", "-c", "1"]
    while True:
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as sampler:
            rest = b""
            # A controller that was killed leaves a halsampler that waits for ever.
            while select.select([sampler.stdout], [], [], _SILENT_S)[0]:
                if not (data := os.read(sampler.stdout.fileno(), 65536)):
                    break
                whole, _, rest = (rest + data).rpartition(b"\n")
                rows = [line.split() for line in whole.split(b"\n")]
                samples = np.array([row for row in rows if len(row) == 8], dtype=float)
                if len(samples):
                    with lock:
                        motion.add(samples, time.monotonic())
            sampler.kill()
        time.sleep(0.5)


def circle_in(p: Array, set_up: SetUp) -> Array:
    """Part of a path (n, 3) mm that is the circle: of the moves between rests, the one that turns farthest
    around the ball. A move to the start passes near the circle, too."""
    speed = np.linalg.norm(np.diff(p, axis=0), axis=1) / _PERIOD_S
    moving = np.flatnonzero(speed > 2.0)
    moves = np.split(moving, np.flatnonzero(np.diff(moving) > 0.5 / _PERIOD_S) + 1)
    x, y, _ = (p[1:] - set_up.centre_mm).T
    turned = [abs(np.ptp(np.unwrap(np.arctan2(y[move], x[move])))) if len(move) else 0.0 for move in moves]
    return p[1:][moves[int(np.argmax(turned))]]


def _answer(request: dict[str, Any], motion: Motion, gauges: Gauges, lock: threading.Lock) -> dict[str, Any]:
    with lock:
        match request["do"]:
            case "mount":
                centre = np.array(request["centre_mm"], dtype=float)
                ball = centre + np.array(request["eccentricity_mm"])
                gauges.set_up = SetUp(request["test"], centre, float(request["radius_mm"]), ball)
            case "record":
                motion.path.clear()
                motion.recording = True
            case "error":
                motion.recording = False
                p, set_up = np.array(motion.path), gauges.set_up
                on_path = circle_in(p, set_up)
                base, taught = circle_error_um(on_path, set_up.centre_mm, set_up.radius_mm)
                return {"samples": len(on_path), "base_um": base, "taught_um": taught, "lost": motion.lost}
    return {"samples": len(motion.numbers), "lost": motion.lost}


def main(directory: Path, user: str, faults: Path) -> None:
    """Serve the cell until it is ended."""
    values = {key: np.array(value, dtype=float) for key, value in yaml.safe_load(faults.read_text()).items()}
    motion, lock = Motion(Arm(Faults(**values))), threading.Lock()
    gauges = Gauges(directory, motion, lock)
    for target in (lambda: _follow(user, motion, lock), gauges.serve):
        threading.Thread(target=target, daemon=True).start()
    place = directory / "cell.socket"
    place.unlink(missing_ok=True)
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(place))
        server.listen()
        while True:
            client, _ = server.accept()
            with client:
                answer = _answer(json.loads(client.makefile().readline()), motion, gauges, lock)
                client.sendall((json.dumps(answer) + "\n").encode())


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3]))
