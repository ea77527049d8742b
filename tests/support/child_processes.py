"""Waiting for what other processes do: polled, with a bound that only a hung one reaches."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


def until(condition: Callable[[], bool], seconds: float = 60.0) -> bool:
    """Whether the condition came true in time."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.01)
    return False


def is_gone(pid: int) -> bool:
    """Whether a process has ended; one that nobody has waited for has ended too."""
    try:
        return (
            Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()[0] == "Z"
        )
    except FileNotFoundError:
        return True


def sign_in(directory: Path) -> None:
    """Leave this process's number in a directory."""
    (directory / str(os.getpid())).touch()


def signed_in(directory: Path) -> list[int]:
    """The processes that left their numbers."""
    return [int(file.name) for file in directory.iterdir() if file.name.isdecimal()]


@dataclass(frozen=True)
class Deadly:
    """An item over which processes die so many times, counted in a directory."""

    directory: Path
    number: int
    times: int

    def __str__(self) -> str:
        return f"item {self.number}"


def die(item: Deadly) -> int:
    """Die over an item as often as it says, then give its number."""
    counted = item.directory / f"deaths-{item.number}"
    with counted.open("a", encoding="ascii") as file:
        file.write("x")
    if counted.stat().st_size <= item.times:
        os.kill(os.getpid(), signal.SIGKILL)
    return item.number
