"""A Dask scheduler and single-threaded workers on this computer, each as a process."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from tests.support.child_processes import until

_LOOPBACK = ("--host", "127.0.0.1", "--no-dashboard")


@dataclass(frozen=True)
class Cluster:
    """A running cluster. address: of the scheduler; workers: their processes."""

    address: str
    workers: tuple[subprocess.Popen[bytes], ...]


@contextmanager
def cluster(directory: Path) -> Iterator[Cluster]:
    """Start a cluster of two workers with its files in a directory. Workers that die are not restarted."""
    file = directory / "scheduler.json"
    with ExitStack() as ends:
        _started(ends, "dask_scheduler", "--port", "0", "--scheduler-file", str(file))
        if not until(lambda: _address(file) != ""):
            raise TimeoutError("no Dask scheduler started")
        options = ("--nthreads", "1", "--no-nanny", "--local-directory", str(directory))
        started = [_started(ends, "dask_worker", _address(file), *options) for _ in range(2)]
        from distributed import Client  # noqa: PLC0415 - an extra

        with Client(_address(file), set_as_default=False) as client:
            client.wait_for_workers(2, timeout=60)
        yield Cluster(_address(file), tuple(started))


def _started(ends: ExitStack, program: str, *options: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", f"distributed.cli.{program}", *_LOOPBACK, *options]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    ends.callback(process.wait)
    ends.callback(process.kill)
    return process


def _address(file: Path) -> str:
    with suppress(FileNotFoundError, json.JSONDecodeError):
        return str(json.loads(file.read_text(encoding="utf-8"))["address"])
    return ""
