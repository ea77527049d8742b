"""Processor time and peak memory of a command, measured from a small parent."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from dataclasses import dataclass

_KEEPING = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
"""A user's environment, where Python keeps compiled modules. Without it every turn would compile rig again, a fifth of
a small run, but not packages that pip compiled."""
_WATCH = """
import os, subprocess, sys
process = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL)
_, status, used = os.wait4(process.pid, 0)
print(used.ru_utime + used.ru_stime, used.ru_maxrss / 1e3)
process.returncode = os.waitstatus_to_exitcode(status)
sys.exit(process.returncode)
"""
"""A small program: a process begins as a copy of its parent, and its peak memory with it."""


@dataclass(frozen=True)
class Cost:
    """Processor time of a process and its children in user and system mode, peak memory, and elapsed time."""

    cpu_s: float
    peak_mb: float
    wall_s: float

    def __str__(self) -> str:
        return f"{self.wall_s:.1f} s, {self.cpu_s:.1f} s of processor time, {self.peak_mb:.0f} MB at most"


def cost(*command: object) -> Cost:
    """Run a command. Raises CalledProcessError if it fails."""
    begin = time.monotonic()
    watched = [sys.executable, "-I", "-c", _WATCH, *map(str, command)]
    done = subprocess.run(watched, stdout=subprocess.PIPE, env=_KEEPING, check=True, text=True)
    return Cost(*map(float, done.stdout.split()), time.monotonic() - begin)
