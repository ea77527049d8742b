"""Run the command `rig` without POSIX-only modules: `python portable_child.py COMMAND…`."""

import os
import sys
import time
from importlib.abc import MetaPathFinder

BLOCKED = {"fcntl", "grp", "pty", "pwd", "resource", "syslog", "termios", "tty"}
ABSENT = ("O_DIRECTORY", "O_NOFOLLOW", "fork", "getuid", "geteuid", "mkfifo", "openpty", "pread", "pwrite", "statvfs")
"""What the documentation of `os` marks as "Availability: Unix", as far as anything here could want it."""


ABSENT_CLOCKS = ("CLOCK_BOOTTIME", "clock_gettime", "clock_gettime_ns")
"""The same of `time`; macOS has the latter two, and not the first."""


class Blocker(MetaPathFinder):
    """Import hook that makes the blocked modules unavailable."""

    def find_spec(self, name: str, path: object = None, target: object = None) -> None:
        if name in BLOCKED:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


for module in BLOCKED:
    sys.modules.pop(module, None)
sys.meta_path.insert(0, Blocker())
import shutil  # noqa: E402 - it looks at `os` when it is imported, and Windows has its disk_usage

for function in ABSENT:
    delattr(os, function)
for function in ABSENT_CLOCKS:
    delattr(time, function)
assert shutil.disk_usage
# private: the type that disk_usage returns, which Windows has too
shutil.disk_usage = lambda path: shutil._ntuple_diskusage(1 << 40, 0, 1 << 40)  # type: ignore[attr-defined]

from analysis.cli import main  # noqa: E402

main()
