"""rigd beside a plain loop of threads: how late stamps are, what is lost, what it costs.

Two gauges stream beside RTDE at 500 Hz, at several rates. The instruments run in a process of their own and note when
each number was handed to the system. rigd and the plain loop take turns, so that a busy computer is as busy for both.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import tempfile
import time
from argparse import Namespace
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import yaml

from daq.service.client import Client
from daq.store import read_run
from rigs.errors import CellError
from rigs.load import find
from tests.support.trial import Trial, main
from tests.trials.pace.pace_cell import STEP_DEG, numbers_of

HERE = Path(__file__).parent
RATES_HZ = (100, 1000, 4000, 12_000)
STREAMS = {"g1": "g1_mm", "g2": "g2_mm", "robot": "q1_deg"}
"""The streams of the cell, each with the column that shows its number."""
_SLICE_NS = 500_000_000
_BEFORE_S = 2.0
_IN_TRANSIT_S = 0.5
_MOST_WAITS = 6
_HELD_UP_NS = 200_000
"""Writing a message takes some 10 µs; an instrument that takes longer was itself kept from running."""
_STREAMED = {"interface": "micro_epsilon_ild1420", "range_mm": 10, "accuracy_mm": 0.01}


@dataclass
class Taken:
    """What a reader made of a cell.

    stamps_ns, values: of each stream, in order. sent_ns: of each number, before and after its sending. window_ns: the
    time that counts. cpu: share of a core.
    """

    stamps_ns: dict[str, np.ndarray]
    values: dict[str, np.ndarray]
    window_ns: tuple[int, int]
    cpu: float
    sent_ns: dict[str, np.ndarray] = field(default_factory=dict)
    faults: Counter[str] = field(default_factory=Counter)

    def numbers(self, stream: str) -> np.ndarray:
        values = self.values[stream]
        return np.round(values / STEP_DEG).astype(int) if stream == "robot" else numbers_of(values)

    def late_ms(self, *streams: str) -> list[np.ndarray]:
        """How much later than its sending each message of these streams was stamped, in slices of the time that counts.

        Those are left out that the instrument itself was held up in sending: when they were sent is unknown.
        """
        begin_ns, end_ns = self.window_ns
        slices = max(1, (end_ns - begin_ns) // _SLICE_NS)
        found: list[list[np.ndarray]] = [[] for _ in range(slices)]
        for stream in streams:
            before_ns, after_ns = self.sent_ns[stream][self.numbers(stream)].T
            known = after_ns - before_ns < _HELD_UP_NS
            places = (before_ns - begin_ns) // _SLICE_NS
            late_ms = (self.stamps_ns[stream] - before_ns) / 1e6
            for place, of_slice in enumerate(found):
                of_slice.append(late_ms[known & (places == place)])
        return [np.concatenate(of_slice) for of_slice in found]

    def lost(self, stream: str) -> int:
        """Numbers missing from the first that was taken to the last that was sent."""
        numbers = self.numbers(stream)
        return len(self.sent_ns[stream]) - int(numbers[0]) - len(np.unique(numbers))


def rig_text() -> str:
    """A UR10e with two gauges that stream."""
    data = yaml.safe_load(find("ur10e-cell").read_text())
    data["gauges"] = {
        name: {**_STREAMED, "port": f"tcp://127.0.0.1:{k}", "offset_mm": 75 - 50 * k}
        for k, name in enumerate(("g1", "g2"), start=1)
    }
    return yaml.safe_dump(data)


@contextmanager
def cell(folder: Path, rate_hz: int) -> Iterator[subprocess.Popen[str]]:
    """The instruments; the rig file of the folder gets their ports."""
    rig = folder / "rig.yaml"
    with _process(folder, sys.executable, HERE / "pace_cell.py", rig, folder / "sent.npz", rate_hz) as process:
        text = ""
        while not text.endswith("\0"):
            text += process.stdout.read(1)
        rig.write_text(text[:-1])
        yield process


@contextmanager
def _process(folder: Path, *command: object) -> Iterator[subprocess.Popen[str]]:
    with (folder / "errors").open("a") as errors:
        process = subprocess.Popen(
            [*map(str, command)], cwd=folder, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, text=True
        )
        try:
            yield process
        finally:
            process.send_signal(signal.SIGTERM)
            process.communicate()


def by_rigd(folder: Path, instruments: subprocess.Popen[str], seconds: float) -> Taken:
    with _process(folder, "rigd", "rig.yaml", "--runs", "runs", "--socket", "rigd.sock") as daemon:
        while not _answers(folder / "rigd.sock"):
            time.sleep(0.05)
        with Client(folder / "rigd.sock") as client:
            while not all(of["counters"].get("samples") for of in client.ask("status")["streams"].values()):
                time.sleep(0.05)
            client.ask("record_start", name="pace", test="repeatability")
        window_ns, cpu = _window(daemon.pid, seconds)
        with Client(folder / "rigd.sock") as client:  # another: rigd closes one that is silent for so long
            _stop(instruments)
            _settle(client)
            run = read_run(Path(client.ask("record_stop")["run"]))
    return Taken(
        {name: np.asarray(run.streams[name]["last_byte_ns"]) for name in STREAMS},
        {name: np.asarray(run.streams[name][column]) for name, column in STREAMS.items()},
        window_ns,
        cpu,
        faults=Counter(str(fault["kind"]) for fault in run.faults if fault["at_ns"] < window_ns[1]),
    )


def _answers(path: Path) -> bool:
    try:
        with Client(path):
            return True
    except CellError:  # the socket is there before the daemon listens
        return False


def _settle(client: Client) -> None:
    """Wait until all sent data have arrived, because a busy computer is late."""
    counted = None
    for _ in range(_MOST_WAITS):
        before, counted = counted, [of["counters"] for of in client.ask("status")["streams"].values()]
        if counted == before:
            return
        time.sleep(_IN_TRANSIT_S)


def by_plain_loop(folder: Path, instruments: subprocess.Popen[str], seconds: float) -> Taken:
    with _process(folder, sys.executable, HERE / "plain_loop.py", "rig.yaml", "kept.npz") as loop:
        loop.stdout.readline()
        window_ns, cpu = _window(loop.pid, seconds)
        _stop(instruments)
        _tell(loop)
    with np.load(folder / "kept.npz") as kept:
        rows = {name: kept[name] for name in STREAMS}
    return Taken(
        {name: of[:, 0].astype(np.int64) for name, of in rows.items()},
        {name: of[:, 1] for name, of in rows.items()},
        window_ns,
        cpu,
    )


def _window(pid: int, seconds: float) -> tuple[tuple[int, int], float]:
    """Wait; return the time that counts, and what share of a core the process took in it."""
    time.sleep(_BEFORE_S)
    begin_ns, before_s = time.monotonic_ns(), _used_s(pid)
    time.sleep(seconds)
    end_ns, after_s = time.monotonic_ns(), _used_s(pid)
    return (begin_ns, end_ns), (after_s - before_s) / (end_ns - begin_ns) * 1e9


def _used_s(pid: int) -> float:
    """Processor time of all threads, to the nanosecond; what `stat` has is counted in ticks."""
    return sum(int(of.read_text().split()[0]) for of in Path(f"/proc/{pid}/task").glob("*/schedstat")) / 1e9


def _stop(instruments: subprocess.Popen[str]) -> None:
    """Stop the instruments, so all their data have arrived shortly afterwards."""
    _tell(instruments)
    time.sleep(_IN_TRANSIT_S)


def _tell(process: subprocess.Popen[str]) -> None:
    assert process.stdin is not None and process.stdout is not None
    process.stdin.write("\n")
    process.stdin.flush()
    process.stdout.readline()


READERS = {"rigd": by_rigd, "plain loop": by_plain_loop}


def measured(reader: str, seconds: float, rate_hz: int) -> Taken:
    """Let a reader take a cell of its own."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        (folder / "rig.yaml").write_text(rig_text())
        with cell(folder, rate_hz) as instruments:
            taken = READERS[reader](folder, instruments, seconds)
        with np.load(folder / "sent.npz") as sent:
            taken.sent_ns = {name: sent[name] for name in sent.files}
        return taken


def judged(case: tuple[int, float, int]) -> bool:
    """Print delay and cost of both readers at a rate; return whether rigd lost no sample."""
    rate_hz, seconds, turns = case
    late = "  p50      p99    quiet    worst"
    print(f"late by ms{'':12} {'gauges: ' + late:>35} {'robot: ' + late:>35} {'CPU':>7} {'lost':>7}")
    found: dict[str, list[Taken]] = {reader: [] for reader in READERS}
    for _ in range(turns):
        for reader, taken in found.items():
            taken.append(measured(reader, seconds, rate_hz))
    for reader, taken in found.items():
        gauges, robot = _late(taken, "g1", "g2"), _late(taken, "robot")
        cpu = 100 * float(np.median([of.cpu for of in taken]))
        told = ", ".join(f"{count} {kind}" for kind, count in sum((of.faults for of in taken), Counter()).items())
        print(f"{rate_hz:6d} Hz  {reader:11} {gauges} {robot} {cpu:6.1f}% {_lost(taken):7d}  {told}", flush=True)
    return not _lost(found["rigd"])


def _lost(taken: Sequence[Taken]) -> int:
    return sum(of.lost(name) for of in taken for name in STREAMS)


def _late(taken: Sequence[Taken], *streams: str) -> str:
    """p50 and p99 of the median slice, p99 of the quietest tenth of the slices, and the worst of all.

    A slice in which the computer served others says what they did; the quiet ones say what the reader can do.
    """
    slices = [late_ms for of in taken for late_ms in of.late_ms(*streams) if len(late_ms)]
    p50, p99 = (np.array([np.percentile(late_ms, percent) for late_ms in slices]) for percent in (50, 99))
    shown = (np.median(p50), np.median(p99), np.percentile(p99, 10), max(late_ms.max() for late_ms in slices))
    return " ".join(f"{value:8.3f}" for value in shown)


def draw(given: Namespace) -> Iterator[tuple[int, float, int]]:
    yield from ((rate, given.seconds, given.turns) for rate in given.rate)


TRIAL = Trial(
    draw,
    judged,
    lambda whole: "no sample missing" if all(whole) else "samples missing",
    line=lambda whole: "",
    failed=lambda whole: not all(whole),
    options={
        "SECONDS": (10.0, "how long each reader takes each cell, in each turn (10)"),
        "turns": (2, "how often they take turns (2)"),
        "rate": (RATES_HZ, "rates in Hz (all)"),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
