"""What `rig window` costs with browsers that follow: its CPU, bytes a second for each, and how late stamps come.

Recordings of an emulated UR10e that drives circles take turns, without a window, with one, and with one that so many
browsers follow; each has the server-sent events of the live page.
"""

from __future__ import annotations

import os
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from daq.service.client import Client
from tests.trials.live_cost.__main__ import driving, late_ms, program

_TICKS = os.sysconf("SC_CLK_TCK")
_ASK = b"GET /events HTTP/1.0\r\nHost: 127.0.0.1\r\n\r\n"
_SETTLES_S = 3.0


class Followers:
    """Browsers that follow a window, with the received bytes and frames."""

    def __init__(self, port: int, count: int) -> None:
        self.received = self.frames = 0
        self._socks = [socket.create_connection(("127.0.0.1", port)) for _ in range(count)]
        for sock in self._socks:
            sock.sendall(_ASK)
            threading.Thread(target=self._take, args=(sock,), daemon=True).start()

    def _take(self, sock: socket.socket) -> None:
        while data := sock.recv(1 << 16):
            self.received += len(data)
            self.frames += data.count(b"event: now")

    def close(self) -> None:
        """Go."""
        for sock in self._socks:
            sock.shutdown(socket.SHUT_RDWR)


@contextmanager
def _window(folder: Path, browsers: int | None) -> Iterator[tuple[int, Followers] | None]:
    """A window with browsers, by the number of its process; None where there is none."""
    if browsers is None:
        yield None
        return
    words = ["rig", "window", "cell/rig.yaml", "--port", "0", "--runs", "runs"]
    said: list[str] = []
    with program(words, folder, "http://", "stdout", said) as process:
        port = int(said[-1].split("127.0.0.1:")[1].split(";")[0])
        followers = Followers(port, browsers)
        time.sleep(_SETTLES_S)
        yield process.pid, followers
        followers.close()


def cpu_s(pid: int) -> float:
    """Processor time of a process, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS


def main(
    seconds: Annotated[float, typer.Argument(help="Length of each recording.")] = 12.0,
    turns: Annotated[int, typer.Option(help="Recordings with each.")] = 4,
    browsers: Annotated[int, typer.Option(help="Browsers that follow.")] = 10,
) -> None:
    """Print p50 and p99 of the lateness, the window's share of a core, and what each browser gets."""
    cases = {"none": None, "window, nobody": 0, f"window, {browsers} browsers": browsers}
    found: dict[str, list[tuple[float, ...]]] = {name: [] for name in cases}
    with driving() as (folder, drive):
        for turn in range(turns):
            drive()
            for number, (name, count) in enumerate(cases.items()):
                with _window(folder, count) as watching:
                    found[name].append(_recorded(folder, f"t{turn}-{number}", seconds, watching, count or 0))
    print(f"{'':22} {'p50 ms':>8} {'p99 ms':>8} {'core':>7} {'kB/s each':>10} {'frames/s':>9}   least, largest p99")
    for name, of in found.items():
        p50, p99, core, each, frames = np.median(of, axis=0)
        p99s = [one[1] for one in of]
        told = f"{name:22} {p50:8.3f} {p99:8.3f} {100 * core:6.1f}% {each / 1e3:10.1f} {frames:9.1f}"
        print(f"{told}   {min(p99s):.3f} to {max(p99s):.3f}")
    print(f"load {os.getloadavg()[0]:.1f}")


def _recorded(
    folder: Path, name: str, seconds: float, watching: tuple[int, Followers] | None, count: int
) -> tuple[float, ...]:
    """p50 and p99 of a recording's lateness in ms, the window's share of a core, bytes and frames a second for each."""
    path = folder / "rigd" / "ur10e.sock"
    with Client(path) as client:
        client.ask("record_start", name=name, test="yaw", direction="acw")
    before_s = cpu_s(watching[0]) if watching else 0.0
    bytes_before, frames_before = (watching[1].received, watching[1].frames) if watching else (0, 0)
    begun_s = time.monotonic()
    time.sleep(seconds)
    took_s = time.monotonic() - begun_s
    core = (cpu_s(watching[0]) - before_s) / took_s if watching else 0.0
    each = (watching[1].received - bytes_before) / took_s / count if watching and count else 0.0
    frames = (watching[1].frames - frames_before) / took_s / count if watching and count else 0.0
    with Client(path) as client:
        late = late_ms(folder / client.ask("record_stop")["run"])
    return float(np.percentile(late, 50)), float(np.percentile(late, 99)), core, each, frames


if __name__ == "__main__":
    typer.run(main)
