"""rigd beside a plain loop of threads: how late stamps are, what is lost, what it costs; polling and a flood.

Two gauges stream beside RTDE at 500 Hz, at several rates; then two gauges on Modbus TCP are polled, beside RTDE and
beside a controller that floods. The instruments run in a process of their own and note when each number was handed to
the system. rigd and the plain loop take turns, so that a busy computer is as busy for both.
"""

from __future__ import annotations

import math
import signal
import subprocess
import sys
import tempfile
import time
from argparse import Namespace
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
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
LIMITS_HZ = (100.0, 500.0)
"""A limit that a rig file may set, and that of one that sets none."""
_NO_LIMIT_HZ = 1e6
STREAMS = {"g1": "g1_mm", "g2": "g2_mm", "robot": "q1_deg"}
"""The streams of the cell, each with the column that shows its number."""
_SLICE_NS = 500_000_000
_BEFORE_S = 2.0
_IN_TRANSIT_S = 0.5
_MOST_WAITS = 6
"""Gauges that are polled go on answering."""
_HELD_UP_NS = 200_000
"""Writing a message takes some 10 µs; an instrument that takes longer was itself kept from running."""
_STREAMED = {"interface": "micro_epsilon_ild1420", "range_mm": 10, "offset_mm": 25, "accuracy_mm": 0.01}
_POLLED = {
    "interface": "modbus_map",
    "function": 4,
    "address": 200,
    "count": 2,
    "value": {"address": 200, "type": "float32"},
}
_LINES = {"interface": "line_feed", "fields": ["t_ms", *(f"q{axis}_deg" for axis in range(1, 7))]}


@dataclass
class Taken:
    """What a reader made of a cell.

    stamps_ns, values: of each stream, in order. sent_ns: of each number, before and after its sending. window_ns: the
    time that counts. cpu: share of a core. shown_hz: the robot's rate in the status.
    """

    stamps_ns: dict[str, np.ndarray]
    values: dict[str, np.ndarray]
    window_ns: tuple[int, int]
    cpu: float
    sent_ns: dict[str, np.ndarray] = field(default_factory=dict)
    faults: Counter[str] = field(default_factory=Counter)
    shown_hz: float = math.nan

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

    def rate_hz(self, stream: str) -> float:
        """Messages a second within the window."""
        begin_ns, end_ns = self.window_ns
        counted = np.count_nonzero((self.stamps_ns[stream] >= begin_ns) & (self.stamps_ns[stream] < end_ns))
        return counted * 1e9 / (end_ns - begin_ns)


def rig_text(gauge: Mapping[str, object], robot: Mapping[str, object] | None = None) -> str:
    """A UR10e with two such gauges."""
    data = yaml.safe_load(find("ur10e").read_text())
    data["gauges"] = {
        "g1": {**gauge, "port": "tcp://127.0.0.1:1", "offset_mm": 25},
        "g2": {**gauge, "port": "tcp://127.0.0.1:2", "offset_mm": -25},
    }
    if robot:
        data["feedback"] = {**robot, "port": "tcp://127.0.0.1:3"}
    return yaml.safe_dump(data)


@contextmanager
def cell(folder: Path, *options: str) -> Iterator[subprocess.Popen[str]]:
    """The instruments; the rig file of the folder gets their ports."""
    rig = folder / "rig.yaml"
    with _process(folder, sys.executable, HERE / "pace_cell.py", rig, folder / "sent.npz", *options) as process:
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
            shown_hz = client.ask("status")["streams"]["robot"]["rate_hz"]
            _stop(instruments)
            _settle(client)
            run = read_run(Path(client.ask("record_stop")["run"]))
    return Taken(
        {name: np.asarray(run.streams[name]["last_byte_ns"]) for name in STREAMS},
        {name: np.asarray(run.streams[name][column]) for name, column in STREAMS.items()},
        window_ns,
        cpu,
        faults=Counter(str(fault["kind"]) for fault in run.faults if fault["at_ns"] < window_ns[1]),
        shown_hz=shown_hz,
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


def measured(text: str, reader: str, seconds: float, *options: str) -> Taken:
    """Let a reader take a cell of its own."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        (folder / "rig.yaml").write_text(text)
        with cell(folder, *options) as instruments:
            taken = READERS[reader](folder, instruments, seconds)
        with np.load(folder / "sent.npz") as sent:
            taken.sent_ns = {name: sent[name] for name in sent.files}
        return taken


def streaming(rate_hz: int, seconds: float, turns: int) -> bool:
    """Print delay and cost of both readers at a rate; return whether rigd lost no sample."""
    found = _in_turns(rig_text(_STREAMED), READERS, seconds, turns, "--rate", str(rate_hz))
    for reader, taken in found.items():
        gauges, robot = _late(taken, "g1", "g2"), _late(taken, "robot")
        cpu = 100 * float(np.median([of.cpu for of in taken]))
        lost = sum(of.lost(name) for of in taken for name in STREAMS)
        told = ", ".join(f"{count} {kind}" for kind, count in sum((of.faults for of in taken), Counter()).items())
        print(f"{rate_hz:6d} Hz  {reader:11} {gauges} {robot} {cpu:6.1f}% {lost:7d}  {told}", flush=True)
    return not sum(of.lost(name) for of in found["rigd"] for name in STREAMS)


def polling(seconds: float, turns: int) -> None:
    """Print how often both readers poll two gauges on Modbus TCP: without a limit, at a limit, and beside a flood."""
    beside_flood = {"rigd": READERS["rigd"]}
    cells = [
        *(
            (
                f"answered in {answer_ms} ms",
                rig_text({**_POLLED, "rate_hz": _NO_LIMIT_HZ}),
                READERS,
                ("--answer-ms", answer_ms),
            )
            for answer_ms in ("0", "1")
        ),
        *(
            (f"at most {hz:g} Hz{where}", rig_text({**_POLLED, "rate_hz": hz}, robot), beside_flood, options)
            for where, robot, options in (("", None, ()), (", beside a flood", _LINES, ("--flood",)))
            for hz in LIMITS_HZ
        ),
    ]
    print(f"\n{'Modbus TCP, readings a second':57} {'g1':>9} {'g2':>9} {'robot':>9} {'as shown':>9} {'CPU':>7}")
    for name, text, readers, options in cells:
        for reader, taken in _in_turns(text, readers, seconds, turns, *options).items():
            rates_hz = [float(np.median([of.rate_hz(stream) for of in taken])) for stream in STREAMS]
            shown_hz, cpu = min(of.shown_hz for of in taken), 100 * float(np.median([of.cpu for of in taken]))
            columns = " ".join(f"{value:9.1f}" for value in (*rates_hz, shown_hz))
            print(f"{name:45} {reader:11} {columns} {cpu:6.1f}%", flush=True)


def _in_turns(text: str, readers: Iterable[str], seconds: float, turns: int, *options: str) -> dict[str, list[Taken]]:
    found: dict[str, list[Taken]] = {reader: [] for reader in readers}
    for _ in range(turns):
        for reader, taken in found.items():
            taken.append(measured(text, reader, seconds, *options))
    return found


def _late(taken: Sequence[Taken], *streams: str) -> str:
    """p50 and p99 of the median slice, p99 of the quietest tenth of the slices, and the worst of all.

    A slice in which the computer served others says what they did; the quiet ones say what the reader can do.
    """
    slices = [late_ms for of in taken for late_ms in of.late_ms(*streams) if len(late_ms)]
    p50, p99 = (np.array([np.percentile(late_ms, percent) for late_ms in slices]) for percent in (50, 99))
    shown = (np.median(p50), np.median(p99), np.percentile(p99, 10), max(late_ms.max() for late_ms in slices))
    return " ".join(f"{value:8.3f}" for value in shown)


def draw(given: Namespace) -> Iterator[tuple[int, float, int]]:
    """Rates at which gauges stream, and 0 for gauges that are polled."""
    yield from ((rate, given.seconds, given.turns) for rate in given.rate)


def judged(case: tuple[int, float, int]) -> bool:
    """Compare rigd with a plain loop; whether rigd lost no sample."""
    rate_hz, seconds, turns = case
    if rate_hz:
        late = "  p50      p99    quiet    worst"
        print(f"late by ms{'':12} {'gauges: ' + late:>35} {'robot: ' + late:>35} {'CPU':>7} {'lost':>7}")
        return streaming(rate_hz, seconds, turns)
    polling(seconds, turns)
    return True


def report(whole: Sequence[bool]) -> str:
    return "no sample missing" if all(whole) else "samples missing"


def has_lost(whole: Sequence[bool]) -> bool:
    return not all(whole)


TRIAL = Trial(
    draw,
    judged,
    report,
    line=lambda whole: "",
    failed=has_lost,
    options={
        "SECONDS": (10.0, "how long each reader takes each cell, in each turn (10)"),
        "turns": (2, "how often they take turns (2)"),
        "rate": ((*RATES_HZ, 0), "rates in Hz, 0 to poll (all)"),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
