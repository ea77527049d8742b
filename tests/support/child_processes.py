"""Waiting for other processes by polling, with a generous time limit."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


def until(condition: Callable[[], bool], seconds: float = 60.0) -> bool:
    """Wait until the condition is true. Return False if the time limit expires first."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.01)
    return False


def is_gone(pid: int) -> bool:
    """True if a process has ended, including a zombie whose parent has not called wait."""
    try:
        return (
            Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()[0] == "Z"
        )
    except FileNotFoundError:
        return True


def sign_in(directory: Path) -> None:
    """Write the id of this process to a directory."""
    (directory / str(os.getpid())).touch()


def signed_in(directory: Path) -> list[int]:
    """Process ids written to a directory by `sign_in`."""
    return [int(file.name) for file in directory.iterdir() if file.name.isdecimal()]


@dataclass(frozen=True)
class Deadly:
    """A work item that kills its worker process the first few times; the kills are counted in a directory."""

    directory: Path
    number: int
    times: int

    def __str__(self) -> str:
        return f"item {self.number}"


def die(item: Deadly) -> int:
    """Kill this process until the item's number of deaths is reached, then return the number of the item."""
    counted = item.directory / f"deaths-{item.number}"
    with counted.open("a", encoding="ascii") as file:
        file.write("x")
    if counted.stat().st_size <= item.times:
        os.kill(os.getpid(), signal.SIGKILL)
    return item.number
