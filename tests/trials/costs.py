"""Costs of many runs and of displays: processor time, memory, bytes, and the delay of stamps; `costs fleet many`.

`fleet`: `rig fleet` for many small runs: first, again, and after a new run; and a run of each test. `remote`: the same
from a directory, an S3 and an SFTP store of this computer. `many`: `rig analyse` in one process, in several, and on
two Dask workers of which one is killed. `live`, `window`: how late stamps come while `rig live` or `rig window` with
browsers watches the recording of an emulated UR10e.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import termios
import threading
import time
from argparse import Namespace
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any, cast

import numpy as np

from analysis import save_run, simulate
from analysis.apps.plant.collect import examine
from daq.service.client import Client
from daq.store import read_run
from tests.support.command_cost import RIG, cost
from tests.support.dask_cluster import cluster
from tests.support.plant_runs import CELL, robot_of, write_visits
from tests.support.remote_stores import s3_store, sftp_store
from tests.support.trial import Trial, main
from tests.trials.plant import DAYS, TESTS

MANY_TESTS = ("yaw acw", "yaw cw", "roll acw", "radial", "repeatability")


# --- many runs


def plant(given: Namespace, directory: Path, robots: int, visits: int, tests: Sequence[str] = TESTS[-1:]) -> int:
    """Write the runs of robots over a year; return their number."""
    robots, visits = given.robots or robots, given.visits or visits
    days = np.linspace(0, DAYS, visits, endpoint=False).tolist()
    for number in range(1, robots + 1):
        robot = robot_of(number, 0, DAYS)
        for _ in write_visits(directory / robot.name, robot, days, list(tests), 0):
            pass
    return robots * visits * len(tests)


def fleet(given: Namespace, work: Path) -> Iterator[str]:
    for title in TESTS:
        yield of_a_run(work, title)
    count, catalogue = plant(given, work / "plant", 200, 50), work / "catalogue.sqlite"
    held = sum(file.stat().st_size for file in (work / "plant").rglob("*") if file.is_file())
    yield f"{count} runs: {held / count / 1e3:.1f} kB a run"
    words = (*RIG, "fleet", work / "plant", "--catalogue", catalogue, "--jobs", given.processes)
    yield f"first time: {cost(*words)}"
    yield f"catalogue: {catalogue.stat().st_size / count / 1e3:.2f} kB a run"
    yield f"again: {cost(*words)}"
    first = robot_of(1, 0, DAYS)
    for _ in write_visits(work / "plant" / first.name, first, [DAYS]):
        pass
    yield f"after one new run: {cost(*words)}"
    yield f"with --parquet: {cost(*words, '--parquet', work / 'figures.parquet')}"
    yield f"Parquet: {(work / 'figures.parquet').stat().st_size / count:.0f} bytes a run"


def of_a_run(work: Path, title: str) -> str:
    """Bytes and seconds of a whole simulated run of a test, as a table of its full rows."""
    test, _, direction = title.partition(" ")
    path = save_run(simulate(CELL, test, direction or None, seed=1), work / title)  # type: ignore[arg-type]
    held = sum(file.stat().st_size for file in path.iterdir())
    examine(path)  # what is slow to import
    begin_s = time.process_time()
    examine(path)
    return f"{title}: {held / 1e3:.0f} kB, {time.process_time() - begin_s:.3f} s of processor time to evaluate"


def remote(given: Namespace, work: Path) -> Iterator[str]:
    """A network would add to the elapsed time; the processor time is that of rig alone."""
    runs, directory = plant(given, work / "plant", 10, 20), work / "plant"
    yield f"{runs} runs"
    with s3_store(directory) as s3, sftp_store(directory, work / "keys") as sftp:
        places: dict[str, tuple[str, Mapping[str, str]]] = {
            "directory": (str(directory), {}),
            "file://": (f"file://{directory}", {}),
            "s3://": (s3.url, s3.environment),
            "sftp://": (sftp.url, sftp.environment),
        }
        for kind, (place, settings) in places.items():
            catalogue = work / f"{kind.partition(':')[0]}.sqlite"
            words = (*RIG, "fleet", place, "--catalogue", catalogue, "--jobs", given.processes)
            for turn in ("first", "again"):
                yield f"{kind} {turn}: {cost(*words, settings=settings)}"


def many(given: Namespace, work: Path) -> Iterator[str]:
    runs = plant(given, work / "plant", 20, 10, MANY_TESTS)
    words = [*RIG, "analyse", str(work / "plant"), "--lines"]
    yield f"{runs} runs, `rig analyse DIR --lines`: elapsed and processor time of all processes, and the output"
    for name, options in (("1 process", ()), ("2 processes", ("--jobs", "2"))):
        yield f"{name}: {evaluated([*words, *options])}"
    (work / "dask").mkdir()
    before = children_cpu_s()
    with cluster(work / "dask") as made:

        def kill(line: int) -> None:
            if line == runs // 3:
                made.workers[0].kill()

        told = evaluated([*words, "--scheduler", made.address], kill)
        if [worker.poll() for worker in made.workers] != [-9, None]:
            raise SystemExit("error: the workers did not end as they should: the first killed, the other alive")
    yield f"2 Dask workers, 1 dies: {told}; {children_cpu_s() - before:.1f} s of processor time with the cluster"


def evaluated(words: Sequence[str], on_line: Callable[[int], None] = lambda line: None) -> str:
    """Times of a command and the digest of its output; on_line: called with the number of each line."""
    begin, cpu_s, digest = time.monotonic(), children_cpu_s(), hashlib.sha256()
    with subprocess.Popen(words, stdout=subprocess.PIPE) as command:
        assert command.stdout
        for number, line in enumerate(command.stdout, 1):
            digest.update(line)
            on_line(number)
    if command.returncode:
        raise subprocess.CalledProcessError(command.returncode, command.args)
    used = f"{time.monotonic() - begin:.1f} s, {children_cpu_s() - cpu_s:.1f} s of processor time"
    return f"{used}, output {digest.hexdigest()[:12]}"


def children_cpu_s() -> float:
    used = os.times()
    return used.children_user + used.children_system


# --- displays of a recording

_NEIGHBOURS_S = 2.0
"""Clocks drift by microseconds in it, and its quickest message was hardly held up."""
_SETTLES_S = 3.0
_TICKS = os.sysconf("SC_CLK_TCK")
_ASK = b"GET /events HTTP/1.0\r\nHost: 127.0.0.1\r\n\r\n"


@contextmanager
def program(words: Sequence[str], folder: Path, ready: str, says_on: str) -> Iterator[tuple[Any, str]]:
    """A program until the end of the context, from its line that contains `ready` on; and that line."""
    pipes = {"stdin": subprocess.PIPE, says_on: subprocess.PIPE}
    process = cast(Any, subprocess.Popen(words, cwd=folder, text=True, env=_env(folder), **pipes))  # type: ignore[call-overload]
    said = process.stdout or process.stderr
    try:
        line = next(line for line in said if ready in line)
        threading.Thread(target=lambda: list(said), daemon=True).start()
        yield process, line
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait()


def _env(folder: Path) -> dict[str, str]:
    return {**os.environ, "XDG_RUNTIME_DIR": str(folder), "TERM": "xterm-256color"}


@contextmanager
def terminal(folder: Path, columns: int, rows: int) -> Iterator[None]:
    """`rig live` in a terminal whose screen is read continuously."""
    master, slave = os.openpty()
    fcntl.ioctl(master, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
    view = subprocess.Popen(["rig", "live"], stdin=slave, stdout=slave, env=_env(folder), start_new_session=True)
    os.close(slave)
    threading.Thread(target=_drain, args=(master,), daemon=True).start()
    try:
        time.sleep(_SETTLES_S)
        yield None
    finally:
        view.send_signal(signal.SIGINT)
        if view.wait():
            raise SystemExit(f"error: rig live ended with {view.returncode}")


def _drain(master: int) -> None:
    with closing(os.fdopen(master, "rb", buffering=0)) as screen, suppress(OSError):  # EIO once the view has gone
        while screen.read(1 << 16):
            pass


class Followers:
    """Browsers that follow a window with its process: received bytes and frames, and processor time."""

    def __init__(self, pid: int, port: int, count: int) -> None:
        self.pid, self.count = pid, count
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
        for sock in self._socks:
            sock.shutdown(socket.SHUT_RDWR)

    def used(self) -> np.ndarray:
        """Processor time in s, and bytes and frames of each browser."""
        fields = Path(f"/proc/{self.pid}/stat").read_text().rpartition(")")[2].split()
        each = max(self.count, 1)
        return np.array([(int(fields[11]) + int(fields[12])) / _TICKS, self.received / each, self.frames / each])


@contextmanager
def browsers(folder: Path, count: int) -> Iterator[Followers]:
    """`rig window` with browsers."""
    words = ["rig", "window", "cell/rig.yaml", "--port", "0", "--runs", "runs"]
    with program(words, folder, "http://", "stdout") as (process, line):
        followers = Followers(process.pid, int(line.split("127.0.0.1:")[1].split(";")[0]), count)
        time.sleep(_SETTLES_S)
        yield followers
        followers.close()


def late_ms(run: Path) -> np.ndarray:
    """By how much (n,) ms each message of the robot was stamped later than the quickest ones around it."""
    robot = read_run(run).streams["robot"]
    stamp_s = np.asarray(robot["first_byte_ns"]) / 1e9
    behind_s = stamp_s - np.asarray(robot["device_time_s"])
    window = ((stamp_s - stamp_s[0]) // _NEIGHBOURS_S).astype(int)
    quickest = [
        rows[np.argmin(behind_s[rows])] for number in np.unique(window) for rows in [np.flatnonzero(window == number)]
    ]
    return 1e3 * (behind_s - np.interp(stamp_s, stamp_s[quickest], behind_s[quickest]))


def watched(given: Namespace, views: Mapping[str, Callable[[Path], Any]]) -> Iterator[str]:
    """Record with each view in turn: lateness, the window's share of a core, and what each browser gets."""
    found: dict[str, list[np.ndarray]] = {name: [] for name in views}
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        emulate = ["rig", "emulate", "ur10e", "--effects", "ur10e", "-o", "cell"]
        robot, _ = stack.enter_context(program(emulate, folder, "ready", "stdout"))
        stack.enter_context(program(["rigd", "cell/rig.yaml", "--runs", "runs"], folder, "serving", "stderr"))
        with Client(folder / "rigd" / "ur10e.sock") as client:
            while not all(stream["counters"].get("samples") for stream in client.ask("status")["streams"].values()):
                time.sleep(0.05)
        for turn in range(given.turns):
            robot.stdin.write("acw\n")
            robot.stdin.flush()
            for number, (name, view) in enumerate(views.items()):
                with view(folder) as followers:
                    found[name].append(_recorded(folder, f"t{turn}-{number}", given.seconds, followers))
    yield f"{'':22} {'p50 ms':>8} {'p99 ms':>8} {'core':>7} {'kB/s each':>10} {'frames/s':>9}   least, largest p99"
    for name, of in found.items():
        p50, p99, core, each, frames = np.median(of, axis=0)
        p99s = [one[1] for one in of]
        told = f"{name:22} {p50:8.3f} {p99:8.3f} {100 * core:6.1f}% {each / 1e3:10.1f} {frames:9.1f}"
        yield f"{told}   {min(p99s):.3f} to {max(p99s):.3f}"


def _recorded(folder: Path, name: str, seconds: float, followers: Followers | None) -> np.ndarray:
    path = folder / "rigd" / "ur10e.sock"
    with Client(path) as client:
        client.ask("record_start", name=name, test="yaw", direction="acw")
    before = followers.used() if followers else np.zeros(3)
    begun_s = time.monotonic()
    time.sleep(seconds)
    used = ((followers.used() if followers else np.zeros(3)) - before) / (time.monotonic() - begun_s)
    with Client(path) as client:
        late = late_ms(folder / client.ask("record_stop")["run"])
    return np.array([*np.percentile(late, (50, 99)), *used])


def live(given: Namespace, work: Path) -> Iterator[str]:
    sizes = ((120, 40), (250, 70))
    views = {f"{columns} x {rows}": lambda folder, c=columns, r=rows: terminal(folder, c, r) for columns, rows in sizes}
    yield from watched(given, {"none": lambda folder: nullcontext()} | views)


def window(given: Namespace, work: Path) -> Iterator[str]:
    views: dict[str, Callable[[Path], Any]] = {"none": lambda folder: nullcontext()}
    for count in (0, given.browsers):
        views[f"window, {count} browsers"] = lambda folder, count=count: browsers(folder, count)
    yield from watched(given, views)


COSTS: dict[str, Callable[[Namespace, Path], Iterator[str]]] = {
    "fleet": fleet, "remote": remote, "many": many, "live": live, "window": window,
}  # fmt: skip


def draw(given: Namespace) -> Iterator[tuple[str, Namespace]]:
    yield from ((name, given) for name in given.names)


def measured(case: tuple[str, Namespace]) -> str:
    name, given = case
    with tempfile.TemporaryDirectory(prefix="rig-costs-", dir=given.where) as work:
        for line in COSTS[name](given, Path(work)):
            print(f"{name}: {line}", flush=True)
    return f"load of the computer at the end {os.getloadavg()[0]:.1f}"


TRIAL = Trial(
    draw, measured,
    options={
        "NAMES": (tuple(COSTS), f"some of {', '.join(COSTS)} (all)"),
        "robots": (int, "robots (fleet 200, remote 10, many 20)"),
        "visits": (int, "runs or days of each robot (fleet 50, remote 20, many 10)"),
        "processes": (1, "processes of rig fleet (1)"),
        "where": (Path, "directory to work in, as /dev/shm (that of temporary files)"),
        "seconds": (12.0, "length of each recording (12)"),
        "turns": (4, "recordings with each view (4)"),
        "browsers": (10, "browsers that follow the window (10)"),
    },
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(main(TRIAL))
