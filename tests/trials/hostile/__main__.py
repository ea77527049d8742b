"""A daemon that records under hostile clients of its control socket, then every command with hostile names and files.

Clients come one by one, at once, silent, slow and flooding, all on this computer's own sockets. Of each round: how many
there were, how many questions of a well-meant client were answered meanwhile, and the daemon's memory, descriptors and
threads. At the end the run must hold all that was sent.
"""

from __future__ import annotations

import contextlib
import socket
import subprocess
import sys
import tempfile
import threading
import time
from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from daq.service.client import Client
from daq.store import read_run, verify
from rigs.errors import RigError
from tests.support.bench import Bench
from tests.support.trial import Trial, main

_GROWTH_MB = 20.0
"""A thread for each of 64 connections takes 0.1 MB; 10 000 that were kept would take 100 MB and more."""
_MOST_DESCRIPTORS = 64
"""Connections that the daemon allows (daq.service.control)."""
_ASK_S = 0.25
_FLOODS, _FLOOD_S = 16, 5.0


@dataclass(frozen=True)
class Held:
    """Resources used by the daemon."""

    memory_mb: float
    descriptors: int
    threads: int


@dataclass
class WellMeant:
    """A client that asks for the status four times a second, in a connection of its own each time."""

    path: Path
    answered: int = 0
    refused: list[str] = field(default_factory=list)
    slowest_s: float = 0.0
    _done: threading.Event = field(default_factory=threading.Event)

    def run(self) -> None:
        while not self._done.wait(_ASK_S):
            begun_s = time.monotonic()
            try:
                with Client(self.path) as client:
                    client.ask("status")
                self.answered += 1
            except RigError as error:
                self.refused.append(str(error))
            self.slowest_s = max(self.slowest_s, time.monotonic() - begun_s)

    @contextlib.contextmanager
    def asking(self) -> Iterator[None]:
        thread = threading.Thread(target=self.run)
        thread.start()
        try:
            yield
        finally:
            self._done.set()
            thread.join()


def held(pid: int) -> Held:
    """Look at a process."""
    process = Path(f"/proc/{pid}")
    status = dict(line.split(":", 1) for line in (process / "status").read_text().splitlines())
    memory_mb = int(status["VmRSS"].split()[0]) / 1024
    return Held(memory_mb, len(list((process / "fd").iterdir())), int(status["Threads"]))


def connected(path: Path) -> socket.socket:
    """A connection, however long the daemon lets it wait."""
    sock = socket.socket(socket.AF_UNIX)
    sock.connect(str(path))
    return sock


def one_after_another(path: Path, count: int) -> int:
    """Connect, ask each tenth time, go."""
    for number in range(count):
        with connected(path) as sock, contextlib.suppress(OSError):
            if number % 10 == 0:
                sock.sendall(b'{"command": "status"}\n')
                sock.recv(1 << 16)
    return count


def at_once(path: Path, count: int) -> int:
    """Open this number of silent connections at the same time; return the number."""
    with ExitStack() as opened:
        for _ in range(count):
            opened.enter_context(connected(path))
    return count


def never_ending(path: Path, count: int) -> int:
    """Begin a request that has no end, and go on with it byte by byte, from as many as the daemon takes at once."""
    sent = 0
    with ExitStack() as opened:
        socks = [opened.enter_context(connected(path)) for _ in range(_FLOODS)]
        until_s = time.monotonic() + _FLOOD_S
        while time.monotonic() < until_s and sent < count:
            for sock in socks:
                with contextlib.suppress(OSError):
                    sock.sendall(b"{")
                    sent += 1
            time.sleep(0.01)
    return sent


def flooding(path: Path, count: int) -> int:
    """Ask without a pause and read no answer, from several connections."""
    sent = [0] * _FLOODS

    def flood(place: int) -> None:
        until_s = time.monotonic() + _FLOOD_S
        while time.monotonic() < until_s and sent[place] < count:
            with connected(path) as sock, contextlib.suppress(OSError):
                sock.settimeout(1.0)
                while time.monotonic() < until_s and sent[place] < count:
                    sock.sendall(b'{"command": "status"}\n')
                    sent[place] += 1

    threads = [threading.Thread(target=flood, args=(place,)) for place in range(_FLOODS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return sum(sent)


def draw(given: Namespace) -> Iterator[int]:
    yield given.connections


def judged(count: int) -> list[str]:
    """Go through the rounds and then through every command; what is wrong."""
    wrong: list[str] = []
    with tempfile.TemporaryDirectory() as scratch, Bench(Path(scratch)) as bench:
        bench.start().all_reading()
        assert bench.daemon
        path = bench.record("hostile")
        bench.recorded(50)
        for sort in (one_after_another, at_once, never_ending, flooding):
            wrong += _round(bench, sort, count)
        done = bench.run("rig", "record", "stop")
        if done.returncode or "while recording" in done.stderr:
            wrong.append(f"rig record stop: {done.stderr.strip()}")
        wrong += verify(path)
        counters = read_run(path).manifest.counters
        rows = {name: len(next(iter(stream.values()))) for name, stream in read_run(path).streams.items()}
        print(f"recorded meanwhile: {', '.join(f'{rows[name]} of {name}' for name in rows)}; counters {counters}")
        wrong += [f"{name}: {faults}" for name, faults in counters.items() if faults.keys() - {"samples"}]
    tests = [sys.executable, "-m", "pytest", "-q", "tests/trials/hostile", "tests/rigs/test_text.py"]
    if subprocess.run(tests, cwd=Path(__file__).parents[3], check=False).returncode:
        wrong.append("a command shows what it must not, or a reader takes what it must not")
    return wrong


def is_wrong(done: Sequence[list[str]]) -> bool:
    return any(done)


def _round(bench: Bench, sort: Callable[[Path, int], int], count: int) -> list[str]:
    """One sort of clients; returns what is wrong."""
    assert bench.daemon
    pid, well_meant = bench.daemon.pid, WellMeant(bench.socket)
    before, begun_s = held(pid), time.monotonic()
    worst = before
    done = threading.Event()

    def watch() -> None:
        nonlocal worst
        while not done.wait(0.1):
            now = held(pid)
            worst = Held(*map(max, zip(vars(worst).values(), vars(now).values(), strict=True)))

    watching = threading.Thread(target=watch)
    watching.start()
    with well_meant.asking():
        number = sort(bench.socket, count)
    done.set()
    watching.join()
    meanwhile = f"well-meant {well_meant.answered} answered, {len(well_meant.refused)} refused"
    print(
        f"{sort.__name__.replace('_', ' ')}: {number} in {time.monotonic() - begun_s:.1f} s; "
        f"{meanwhile}, slowest {well_meant.slowest_s:.2f} s; "
        f"memory {before.memory_mb:.0f} to {worst.memory_mb:.0f} MB, descriptors {before.descriptors} to "
        f"{worst.descriptors}, threads {before.threads} to {worst.threads}",
        flush=True,
    )
    wrong = [f"{sort.__name__}: {reason}" for reason in well_meant.refused]
    if worst.memory_mb - before.memory_mb > _GROWTH_MB:
        wrong.append(f"{sort.__name__}: grown by {worst.memory_mb - before.memory_mb:.0f} MB")
    if worst.descriptors - before.descriptors > _MOST_DESCRIPTORS:
        wrong.append(f"{sort.__name__}: {worst.descriptors - before.descriptors} more descriptors")
    return wrong


TRIAL = Trial(
    draw,
    judged,
    line=lambda wrong: "\n".join(wrong) or "no client kept another from its answer, none the recorder",
    failed=is_wrong,
    options={"connections": (10_000, "connections of each round (10000)")},
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
