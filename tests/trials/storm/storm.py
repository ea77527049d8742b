"""A storm: one world after the other, each from its seed, as long as there is time."""

from __future__ import annotations

import gc
import logging
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from unittest.mock import patch

from daq.acquisition import stream_buffer
from daq.emulators.simulated_clock import SimulatedClock, close_files_in
from daq.recording import active_run
from daq.store import durable, writer
from tests.trials.storm.blows import BLOWS
from tests.trials.storm.judging import judge_runs
from tests.trials.storm.life import Heard, Life, Told
from tests.trials.storm.worlds import World, world

_ROOM, _PENDING = 150, 100
"""Rows that a small room holds: a disk that is slow for seconds overflows it."""


def weather(seed: int) -> Told:
    """Live the world of a seed to its end, and judge it."""
    drawn, began_s = world(seed), time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="rig-storm-") as scratch, _overheard() as heard, _rooms_of(drawn):
        time_ = SimulatedClock(seed)
        life = None
        try:
            with time_.running():
                life = Life(drawn, Path(scratch), time_, heard)
                with patch.object(durable, "os", life.disk):  # the disk of the store
                    life.live(BLOWS)
            judge_runs(life)
        except Exception as error:  # noqa: BLE001 - whatever it is, the world of this seed has failed
            told = life.told if life else Told(drawn)
            where = traceback.format_exception(error)[-6:]
            told.violations.append(f"{type(error).__name__}: {error} {' '.join(where)}")
        finally:
            close_files_in(Path(scratch))
        told = life.told if life else Told(drawn)
        told.violations += heard.wrong
        told.seconds, told.took_s = time_.elapsed_s, time.perf_counter() - began_s
        return told


@contextmanager
def _rooms_of(drawn: World) -> Iterator[None]:
    """Make rooms and chunks as small as the world has them."""
    sizes = [(writer, "CHUNK_AGE_NS", round(drawn.chunk_s * 1e9))]
    if drawn.small:  # private _ROOM: as large as it has it
        sizes.append((stream_buffer, "_ROOM", _ROOM))
        sizes += [(module, "MOST_PENDING", _PENDING) for module in (active_run, writer)]
    with ExitStack() as stack:
        for module, name, size in sizes:
            stack.enter_context(patch.object(module, name, size))
        yield


@contextmanager
def _overheard() -> Iterator[Heard]:
    """Collect the daemon's messages about the disk and about internal errors within the context."""
    heard = Heard()

    class Ear(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            heard.slow += record.getMessage().startswith("disk: slow")
            if record.exc_info or "internal error" in record.getMessage():
                detail = "".join(traceback.format_exception(record.exc_info[1])[-3:]) if record.exc_info else ""
                heard.wrong.append(f"the log tells of an error in the program: {record.getMessage()} {detail}")

    log, ear, hook, interval_s = logging.getLogger("rigd"), Ear(), threading.excepthook, sys.getswitchinterval()
    level, passes = log.level, log.propagate
    log.addHandler(ear)
    log.setLevel(logging.INFO)
    log.propagate = False
    threading.excepthook = lambda args: heard.wrong.append(
        f"a thread died of {args.exc_type.__name__}: {args.exc_value}"
    )
    try:
        yield heard
    finally:
        log.removeHandler(ear)
        log.setLevel(level)
        log.propagate, threading.excepthook = passes, hook
        sys.setswitchinterval(interval_s)
        gc.unfreeze()  # which a daemon does for its life, and there are many here
