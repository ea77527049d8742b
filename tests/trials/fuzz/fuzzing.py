"""The campaign: blocks of inputs, each block in a worker process and reproducible by its target, seed and number.

An input that raises, takes long or leaves the process larger is a failure, and is shown so that it can become a test.
"""

from __future__ import annotations

import contextlib
import os
import signal
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from random import Random
from types import FrameType

from tests.trials.fuzz import fuzz_control, fuzz_files, fuzz_values, fuzz_wires

HANG_S = 10.0
GROWTH_MB = 48.0
BLOCK = {"rig_files": 200, "runs": 500, "tables": 1000, "chunk_values": 200}
WIRE_BLOCK = 20_000


@dataclass(frozen=True)
class Block:
    """Work of one process: a number of inputs for a target."""

    target: str
    seed: int
    number: int
    inputs: int


@dataclass(frozen=True)
class Outcome:
    """What became of a block. rss_mb: of the worker at its end; slowest_s: one input, or one conversation of them."""

    block: Block
    inputs: int
    seconds: float
    slowest_s: float
    rss_mb: float
    pid: int
    failure: str = ""


class Hang(BaseException):
    """An input took longer than HANG_S."""


@cache
def targets() -> dict[str, list[Callable[[Random], int]]]:
    """Feeds by target: the interfaces, the control socket, the files."""
    files = {**fuzz_files.files(), "chunk_values": [fuzz_values.crafted]}
    return {**fuzz_wires.wires(), **fuzz_control.control(), **files}


def is_file(target: str) -> bool:
    return target in BLOCK


def blocks(target: str, seed: int, inputs: int) -> list[Block]:
    size = BLOCK.get(target, WIRE_BLOCK)
    return [
        Block(target, seed, number, min(size, inputs - start)) for number, start in enumerate(range(0, inputs, size))
    ]


def run_block(block: Block) -> Outcome:
    """Feed the inputs of one block, up to the first failure."""
    began, done, slowest, failure = time.perf_counter(), 0, 0.0, ""
    feeds, conversation = targets()[block.target], 0
    while done < block.inputs and not failure:
        at = f"{block.target} {block.seed} {block.number} {conversation}"
        start = time.perf_counter()
        try:
            with _no_longer_than(HANG_S):
                done += feeds[conversation % len(feeds)](Random(at))
        except (Exception, Hang) as error:  # noqa: BLE001 - any exception is what is looked for
            failure = f"{at}: {error!r}\n{traceback.format_exc()}\n{_last_input(error)}"
        slowest = max(slowest, time.perf_counter() - start)
        conversation += 1
    return Outcome(block, done, time.perf_counter() - began, slowest, _rss_mb(), os.getpid(), failure)


def _last_input(error: BaseException) -> str:
    """The spoilt bytes, found in the frames that the error passed, or the file put last."""
    trace, said = error.__traceback__, list[bytes]()
    while trace is not None:
        for thing in trace.tb_frame.f_locals.values():
            said = thing.said if isinstance(thing, fuzz_wires.Watched) else said
        trace = trace.tb_next
    said = said or fuzz_files.BENCH.said
    return "inputs: " + " ".join(data.hex() or "-" for data in said)[-20_000:]


@contextlib.contextmanager
def _no_longer_than(seconds: float) -> Iterator[None]:
    def ring(_: int, __: FrameType | None) -> None:
        raise Hang

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def _rss_mb() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6
