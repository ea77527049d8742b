"""SIGKILL at random moments of a recording: the next start of rigd recovers, and what was synced is there.

One time in four the kill falls into the end of the recording, one time in ten the daemon that recovers is
killed as well. Half of the daemons roll their chunks every 0.4 s, so that kills fall into that too. What
was synced is known from the daemon's status, asked without a pause until the kill; that no row is wrong,
from readings that are numbers in order. Of the tail that is lost no part is the time for which the stream had
brought nothing when the status was asked last: on a computer that is busy a pty may pass on nothing for seconds.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
import tempfile
import threading
import time
from argparse import Namespace
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import yaml

from daq.emulators.instruments import emulated
from daq.service.client import Client
from daq.store import load_manifest, read_run, verify
from rigs.errors import RigError
from rigs.load import find, parse
from tests.support.trial import Trial, main

STEP_MM, STEP_DEG = 1e-4, 1e-6
"""From one reading to the next."""
COLUMNS = {"g1": ("g1_mm", STEP_MM), "g2": ("g2_mm", STEP_MM), "robot": ("q1_deg", STEP_DEG)}
ROLLING = "import daq.store.writer as w; w.CHUNK_AGE_NS = 4 * 10**8\nfrom daq.service.rigd import main; main()"
PATIENCE_S = 60.0
MOST_LOST_S = 1.0


class Counting:
    """Instruments that show how often they have been read."""

    def __init__(self) -> None:
        self.count: Counter[str] = Counter()

    def gauge_mm(self, name: str, now_ns: int) -> float:
        self.count[name] += 1
        return self.count[name] * STEP_MM

    def joints_deg(self, now_ns: int) -> list[float]:
        self.count["robot"] += 1
        return [self.count["robot"] * STEP_DEG] * 6


@dataclass(frozen=True)
class Killed:
    """A recording that was cut off: rows known to be synced, seconds since each stream brought something, as known
    last, and the host's clock at the start and after the kill."""

    path: Path
    synced: dict[str, int]
    quiet_s: dict[str, float]
    ending: bool
    start_ns: int
    kill_ns: int


@dataclass
class Tally:
    """Results of the kills. tails_s: maximum of each stream."""

    kills: int = 0
    while_ending: int = 0
    while_recovering: int = 0
    rows: int = 0
    tails_s: dict[str, float] = field(default_factory=lambda: dict.fromkeys(COLUMNS, 0.0))
    problems: list[str] = field(default_factory=list)

    def add(self, killed: Killed) -> str:
        """Compare a run with the known truth, and return the result as text."""
        problems, tails_s = _held_to(killed)
        self.kills += 1
        self.while_ending += killed.ending
        self.rows += sum(killed.synced.values())
        self.problems += problems
        for name, tail_s in tails_s.items():
            self.tails_s[name] = max(self.tails_s[name], tail_s)
        return f"{'; '.join(problems) or 'whole'}, tail {max(tails_s.values(), default=0):.2f} s"

    def __str__(self) -> str:
        ends = f"{self.while_ending} while the recording ended"
        worst = ", ".join(f"{name} {tail_s:.2f} s" for name, tail_s in self.tails_s.items())
        good = "all that was synced is there and verifies, each start recovered by itself"
        return "\n".join([
            f"{self.kills} kills, {ends}; {self.while_recovering} more of a daemon that was recovering",
            f"{self.rows} rows were known to be synced; worst tail lost: {worst}",
            f"{len(self.problems)} problems" if self.problems else good,
        ])  # fmt: skip


def draw(given: Namespace) -> Iterator[tuple[int, int]]:
    yield given.count, given.seed


def judged(case: tuple[int, int]) -> Tally:
    """Kill, start, recover, verify, as often as asked."""
    count, seed = case
    text, tally = _rig_text(), Tally()
    cell = emulated(parse(text, "kill"), Counting())
    with tempfile.TemporaryDirectory(prefix="rig-kill-") as scratch:
        folder = Path(scratch)
        (folder / "rig.yaml").write_text(cell.rig_text(text))
        cell.start()
        try:
            _campaign(folder, count, Random(seed), tally)
        finally:
            cell.stop()
    return tally


def has_problems(done: Sequence[Tally]) -> bool:
    return any(tally.problems for tally in done)


def _rig_text() -> str:
    """The paper's gauges on a UR10e."""
    data = yaml.safe_load(find("ur10e").read_text())
    data["gauges"] = yaml.safe_load(find("paper-fanuc").read_text())["gauges"]
    return yaml.safe_dump(data)


def _campaign(folder: Path, count: int, random: Random, tally: Tally) -> None:
    killed: Killed | None = None
    for number in range(count + 1):
        if killed and random.random() < 0.1:
            tally.while_recovering += 1
            with _daemon(folder, random):
                time.sleep(random.uniform(0, 0.1))
        with _daemon(folder, random) as process:
            if killed:
                print(f"{number} of {count}: {tally.add(killed)}", flush=True)
            if number < count:
                killed = _record(folder, random, process)


@contextlib.contextmanager
def _daemon(folder: Path, random: Random) -> Iterator[subprocess.Popen[str]]:
    """A daemon that serves, killed at the end."""
    program = [sys.executable, "-c", ROLLING] if random.random() < 0.5 else ["rigd"]
    command = [*program, "rig.yaml", "--runs", "runs", "--socket", "rigd.sock"]
    process = subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    said = []
    try:
        for line in process.stderr:
            said.append(line)
            if "serving" in line:
                break
        else:
            raise AssertionError("".join(said))
        yield process
    finally:
        process.kill()
        process.communicate()


def _record(folder: Path, random: Random, process: subprocess.Popen[str]) -> Killed:
    with Client(folder / "rigd.sock") as client:
        _until(lambda: all(stream["rate_hz"] > 1 for stream in client.ask("status")["streams"].values()))
        path = Path(client.ask("record_start", name="kill", test="yaw", direction="acw")["run"])
        start_ns = time.monotonic_ns()
        kill_at = time.monotonic() + random.uniform(0, 1.6)
        synced: dict[str, int] = {}
        quiet_s = dict.fromkeys(COLUMNS, 0.0)
        while time.monotonic() < kill_at:
            state = client.ask("status")
            synced = state["synced"]
            quiet_s = {name: state["streams"][name]["age_s"][column] for name, (column, _) in COLUMNS.items()}
        if ending := random.random() < 0.25:
            threading.Thread(target=_stop, args=(folder / "rigd.sock",), daemon=True).start()
            time.sleep(random.uniform(0, 0.08))
        process.kill()
        return Killed(path, synced, quiet_s, ending, start_ns, time.monotonic_ns())


def _stop(socket: Path) -> None:
    """Stop the recording, if the daemon still runs."""
    with contextlib.suppress(RigError), Client(socket) as client:
        client.ask("record_stop")


def _held_to(killed: Killed) -> tuple[list[str], dict[str, float]]:
    """What is wrong with the run, once the daemon has recovered it, and seconds lost at the end of each stream."""
    path = killed.path
    try:
        _until(lambda: load_manifest(path).exit_status != "recording" and not any(path.glob("*.arrow")))
        problems = verify(path)
        streams = read_run(path).streams
    except (RigError, AssertionError) as error:
        return [f"{path.name}: {error}"], {}
    tails: dict[str, float] = {}
    for name, (column, step) in COLUMNS.items():
        numbers = np.round(streams[name][column] / step).astype(int)
        if len(numbers) < killed.synced.get(name, 0):
            problems.append(f"{name}: {len(numbers)} rows, {killed.synced[name]} were synced")
        if (np.diff(numbers) != 1).any():
            problems.append(f"{name}: a row is wrong, missing or doubled")
        stamps = streams[name]["last_byte_ns"]
        since_s = (killed.kill_ns - (int(stamps[-1]) if len(stamps) else killed.start_ns)) / 1e9
        tails[name] = max(0.0, since_s - killed.quiet_s[name])
        if tails[name] > MOST_LOST_S:
            problems.append(f"{name}: the last {tails[name]:.2f} s are lost")
    return problems, tails


def _until(what: Any) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not what():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.01)


TRIAL = Trial(
    draw,
    judged,
    failed=has_problems,
    count=10,
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
