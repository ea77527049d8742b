"""How late stamps come with and without `rig live` watching: recordings of an emulated UR10e take turns."""

from __future__ import annotations

import fcntl
import os
import signal
import struct
import subprocess
import tempfile
import termios
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path
from typing import Annotated, cast

import numpy as np
import typer

from daq.service.client import Client
from daq.store import read_run

VIEWS = {"none": None, "120 x 40": (120, 40), "250 x 70": (250, 70)}
_NEIGHBOURS_S = 2.0
"""Clocks drift by microseconds in it, and its quickest message was hardly held up."""
_FIRST_DRAWN_S = 2.5


@contextmanager
def program(
    words: Sequence[str], folder: Path, ready: str, says_on: str, heard: list[str] | None = None
) -> Iterator[subprocess.Popen[str]]:
    """A program of ours from its line that contains `ready` on, ended at the end. heard: takes that line."""
    pipes = {"stdin": subprocess.PIPE, says_on: subprocess.PIPE}
    process = cast(subprocess.Popen[str], subprocess.Popen(words, cwd=folder, text=True, env=_env(folder), **pipes))  # type: ignore[call-overload]
    said = process.stdout or process.stderr
    assert said is not None
    try:
        line = next(line for line in said if ready in line)
        if heard is not None:
            heard.append(line)
        threading.Thread(target=lambda: list(said), daemon=True).start()
        yield process
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait()


def _env(folder: Path) -> dict[str, str]:
    return {**os.environ, "XDG_RUNTIME_DIR": str(folder), "TERM": "xterm-256color"}


@contextmanager
def _watching(size: tuple[int, int] | None, folder: Path) -> Iterator[None]:
    """Run `rig live` in a terminal of the given size within the context, and read the screen continuously."""
    if size is None:
        yield
        return
    master, slave = os.openpty()
    fcntl.ioctl(master, termios.TIOCSWINSZ, struct.pack("HHHH", size[1], size[0], 0, 0))
    view = subprocess.Popen(["rig", "live"], stdin=slave, stdout=slave, env=_env(folder), start_new_session=True)
    os.close(slave)
    threading.Thread(target=_drain, args=(master,), daemon=True).start()
    try:
        time.sleep(_FIRST_DRAWN_S)
        yield
    finally:
        view.send_signal(signal.SIGINT)
        if view.wait():
            raise RuntimeError(f"rig live ended with {view.returncode}")


def _drain(master: int) -> None:
    with closing(os.fdopen(master, "rb", buffering=0)) as screen, suppress(OSError):  # EIO once the view has gone
        while screen.read(1 << 16):
            pass


def late_ms(run: Path) -> np.ndarray:
    """Return by how much each message of the robot was stamped later than the quickest ones around it, (n,) ms."""
    robot = read_run(run).streams["robot"]
    stamp_s = np.asarray(robot["first_byte_ns"]) / 1e9
    behind_s = stamp_s - np.asarray(robot["device_time_s"])
    window = ((stamp_s - stamp_s[0]) // _NEIGHBOURS_S).astype(int)
    quickest = [
        rows[np.argmin(behind_s[rows])] for number in np.unique(window) for rows in [np.flatnonzero(window == number)]
    ]
    return 1e3 * (behind_s - np.interp(stamp_s, stamp_s[quickest], behind_s[quickest]))


def recorded(folder: Path, name: str, size: tuple[int, int] | None, seconds: float) -> np.ndarray:
    """Return the lateness (n,) ms of a recording that a view of this size watches."""
    with _watching(size, folder):
        with Client(folder / "rigd" / "ur10e.sock") as client:
            client.ask("record_start", name=name, test="yaw", direction="acw")
        time.sleep(seconds)
        with Client(folder / "rigd" / "ur10e.sock") as client:
            return late_ms(folder / client.ask("record_stop")["run"])


@contextmanager
def driving() -> Iterator[tuple[Path, Callable[[], None]]]:
    """An emulated UR10e with its daemon, all of whose streams bring samples: their directory, and what has the robot
    drive a circle."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        emulate = ["rig", "emulate", "ur10e", "--effects", "ur10e", "-o", "cell"]
        cell = stack.enter_context(program(emulate, folder, "ready", "stdout"))
        stack.enter_context(program(["rigd", "cell/rig.yaml", "--runs", "runs"], folder, "serving", "stderr"))
        with Client(folder / "rigd" / "ur10e.sock") as client:
            while not all(stream["counters"].get("samples") for stream in client.ask("status")["streams"].values()):
                time.sleep(0.05)

        def drive() -> None:
            assert cell.stdin is not None
            cell.stdin.write("acw\n")
            cell.stdin.flush()

        yield folder, drive


def main(
    seconds: Annotated[float, typer.Argument(help="Length of each recording.")] = 12.0,
    turns: Annotated[int, typer.Option(help="Recordings with each view.")] = 4,
) -> None:
    """Print p50 and p99 of the lateness for each view."""
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in VIEWS}
    with driving() as (folder, drive):
        for turn in range(turns):
            drive()
            for name, size in VIEWS.items():
                late = recorded(folder, f"t{turn}-{name.replace(' ', '')}", size, seconds)
                found[name].append((float(np.percentile(late, 50)), float(np.percentile(late, 99))))
    print(f"{'view':10} {'p50 ms':>8} {'p99 ms':>8}   least and largest p99, load {os.getloadavg()[0]:.1f}")
    for name, of in found.items():
        (p50, p99), p99s = np.median(of, axis=0), [p99 for _, p99 in of]
        print(f"{name:10} {p50:8.3f} {p99:8.3f}   {min(p99s):.3f} to {max(p99s):.3f}")


if __name__ == "__main__":
    typer.run(main)
